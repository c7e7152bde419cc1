"""The async tests of families run in driven time, and have the devices that those of sessions have."""

from tests.session.conftest import pytest_pycollect_makeitem, rig, rplidar, ydlidar

__all__ = ["pytest_pycollect_makeitem", "rig", "rplidar", "ydlidar"]
