"""Small changes of the source, and which of them the tests notice."""
