"""What a user holds: one device, from opening it to leaving it still."""
