"""RPLIDAR: the A, C, S and T series."""

from __future__ import annotations

from lidario.families.base import Family, Timing
from lidario.families.rplidar.device import RplidarDevice
from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.raw import find_stream, stream_in

__all__ = ["FAMILY"]

FAMILY = Family(
    name="rplidar",
    title="RPLIDAR",
    # S2, S2L and S3; S1, A3, A2M7 and A2M12; A1 and A2M8; C1 (vendor's ROS launch files).
    baudrates=(1000000, 256000, 115200, 460800),
    timing=Timing(
        # The slowest packets are those of an A1 in Stability: one in 19.3 ms, behind an adapter that may hold them
        # for 16 ms more.
        quiet_s=0.045,
        drain_s=0.5,
        # Users report 2 s of silence from an S1; the vendor's ROS node gives it 15 s.
        boot_s=8.0,
        boot_poll_s=0.25,
        # "Request packets' format": a request must be complete within 5 s.
        forget_s=5.0,
        probe_s=0.15,
    ),
    device=RplidarDevice,
    formats=tuple(FORMATS.values()),
    find_stream=find_stream,
    stream_in=stream_in,
)
