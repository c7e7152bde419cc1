"""Delta-2A, 2B, 2D and 2G of 3irobotix (Shanchuan), and the LDS08RR of the same kind: turrets of robot vacuums.

They stream for as long as their rotor turns, and hear nothing. The host powers the motor by wires of its own, so no
request sets the speed; what is measured is told. Sources: 3irobotix's SDK 1.7.1 and protocol documents, community
ports; nothing was tried with a device.
"""

from __future__ import annotations

from typing import Final

from lidario.families.base import Family, Timing
from lidario.families.irobotix.device import TALKERS
from lidario.families.irobotix.formats import FifteenFormat, FrameFormat

__all__ = ["FAMILY"]

SIMULATED: Final = (
    "irobotix-delta2a",
    "irobotix-delta2b",
    "irobotix-delta2d",
    "irobotix-delta2g",
    "irobotix-lds08rr",
)
"""The names of `simulated.device.PROFILES`, repeated: users of a real device do not load the simulated one."""

FAMILY: Final = Family(
    name="irobotix",
    title="3irobotix",
    # Delta-2A and 2B; the others, and older 2A.
    baudrates=(230_400, 115_200),
    timing=Timing(
        # At four revolutions a second a frame takes 17 ms, and a USB adapter may hold bytes back for 16 ms.
        quiet_s=0.06,
        drain_s=0.5,
        # It cannot be restarted from here.
        boot_s=3.0,
        boot_poll_s=0.25,
        # It hears nothing. One that has just been given power sends a second or two later.
        forget_s=3.0,
        probe_s=0.12,
    ),
    device=TALKERS.device,
    formats=(FrameFormat, FifteenFormat),
    simulated=SIMULATED,
    find_stream=TALKERS.find_stream,
    stream_of=TALKERS.stream_of,
    models=TALKERS.named,
    # It only talks: nothing is asked at any speed.
    asked_at=(),
)
"""The family's row of the registry."""
