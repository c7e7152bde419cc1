"""What runs in the environment of the other drivers: no lidario here, and nothing but a driver and pyserial."""
