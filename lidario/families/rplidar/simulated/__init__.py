"""The device side of the RPLIDAR protocol, for tests and for those who have no lidar."""

from lidario.families.rplidar.simulated.device import PROFILES, make_simulated

__all__ = ["PROFILES", "make_simulated"]
