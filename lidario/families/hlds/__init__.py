"""Hitachi-LG LDS-01 (HLS-LFCD2, HLS-LFCD-LDS, LDS360): the first lidar of the TurtleBot3.

A sample a degree, five revolutions a second. It is started and stopped by letters, to which it responds nothing.
Source: ROBOTIS' driver ``hls_lfcd_lds_driver``; no request and no packet was tried with a device.
"""

from __future__ import annotations

from typing import Final

from lidario.families.base import Family, Timing
from lidario.families.hlds.device import TALKERS
from lidario.families.hlds.formats import CheckedFormat, PacketFormat

__all__ = ["FAMILY"]

SIMULATED: Final = ("hlds-lds01", "hlds-lds01-2016")
"""The names of `simulated.device.PROFILES`, repeated: users of a real device do not load the simulated one."""

FAMILY: Final = Family(
    name="hlds",
    title="HLDS",
    baudrates=(230_400,),
    timing=Timing(
        # A packet takes 3.3 ms, and a USB adapter may hold bytes back for 16 ms.
        quiet_s=0.05,
        drain_s=0.5,
        boot_s=3.0,
        boot_poll_s=0.25,
        forget_s=0.5,
        probe_s=0.12,
        # One that waits for its letter sends nothing before it turns evenly.
        starts_s=1.3,
    ),
    device=TALKERS.device,
    formats=(CheckedFormat, PacketFormat),
    simulated=SIMULATED,
    find_stream=TALKERS.find_stream,
    stream_of=TALKERS.stream_of,
    models=TALKERS.named,
)
"""The family's row of the registry."""
