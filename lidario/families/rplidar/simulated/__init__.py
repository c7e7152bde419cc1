"""The device side of the RPLIDAR protocol, for tests and for those who have no lidar."""
