"""An open line with one interface: serial port, TCP connection or simulated device."""
