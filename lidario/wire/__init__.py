"""The sans-IO core: bytes and time in, typed events out; no socket, clock, thread or logging."""
