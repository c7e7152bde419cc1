"""The device side, written from the documents alone: it shares nothing with the driver."""
