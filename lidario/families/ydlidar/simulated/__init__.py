"""The device side of the YDLIDAR 4ROS, for tests and for those who have no lidar."""
