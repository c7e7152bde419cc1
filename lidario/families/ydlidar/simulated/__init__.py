"""The device side of the YDLIDAR 4ROS, for tests and for those who have no lidar."""

from lidario.families.ydlidar.simulated.device import PROFILES, make_simulated

__all__ = ["PROFILES", "make_simulated"]
