"""Camsense X1, and the LDS08RR of the same kind: turrets of robot vacuums, sold bare.

They turn and stream for as long as they have power, and hear nothing. Sources: Camsense's ``T2SDK``, 47 packets
of a real X1 (github.com/thijses/camsense-X1), community ports.
"""

from __future__ import annotations

from typing import Final

from lidario.families.base import Family, Timing
from lidario.families.camsense.device import TALKERS
from lidario.families.camsense.formats import LongFormat, PacketFormat

__all__ = ["FAMILY"]

SIMULATED: Final = ("camsense-x1", "camsense-lds08rr")
"""The names of `simulated.device.PROFILES`, repeated: users of a real device do not load the simulated one."""

FAMILY: Final = Family(
    name="camsense",
    title="Camsense",
    baudrates=(115_200,),
    timing=Timing(
        # A packet takes 3.8 ms, and a USB adapter may hold bytes back for 16 ms.
        quiet_s=0.05,
        drain_s=0.5,
        # It cannot be restarted from here.
        boot_s=3.0,
        boot_poll_s=0.25,
        # It hears nothing. One that has just been given power sends a second or two later.
        forget_s=3.0,
        probe_s=0.12,
    ),
    device=TALKERS.device,
    formats=(PacketFormat, LongFormat),
    simulated=SIMULATED,
    find_stream=TALKERS.find_stream,
    stream_of=TALKERS.stream_of,
    models=TALKERS.named,
    # It only talks: nothing is asked at any speed.
    asked_at=(),
)
"""The family's row of the registry."""
