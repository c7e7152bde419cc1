"""An open line with one face: serial port, TCP connection or simulator."""
