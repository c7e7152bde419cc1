"""The stream of one device, and those who read it."""
