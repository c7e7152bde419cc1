"""What all rooms need: checks of arguments, sources, records of a device, words for messages."""
