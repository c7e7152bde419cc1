"""LDROBOT LD06, LD19, STL-06P, STL-19P, STL-26, STL-27L, LD08, LD14 and LD14P.

Sources throughout: the LD06 development manual v1.0, the vendor's SDKs, and a recording of a real LD06, from which
sample rate and unsteadiness are known. All but one model only talk; no request was tried on a real device.
"""

from __future__ import annotations

from typing import Final

from lidario.families.base import Family, Timing
from lidario.families.ldrobot.device import NAMED, LdrobotDevice
from lidario.families.ldrobot.formats import PacketFormat
from lidario.families.ldrobot.raw import find_stream, stream_of

__all__ = ["FAMILY"]

SIMULATED: Final = (
    "ldrobot-ld06",
    "ldrobot-ld19",
    "ldrobot-stl06p",
    "ldrobot-stl19p",
    "ldrobot-stl26",
    "ldrobot-stl27l",
    "ldrobot-ld08",
    "ldrobot-ld14",
    "ldrobot-ld14p",
)
"""The names of `simulated.PROFILES`, repeated here so that users of a real device do not load the simulated one."""

FAMILY: Final = Family(
    name="ldrobot",
    title="LDROBOT",
    # LD06, LD19 and LD14P; LD08 and LD14; STL-27L.
    baudrates=(230_400, 115_200, 921_600),
    timing=Timing(
        # Packets come every 5 ms at most, and a USB adapter may hold bytes back for 16 ms.
        quiet_s=0.05,
        drain_s=0.5,
        # It cannot be restarted from here. After power-up the first packets come within 0.7 s.
        boot_s=3.0,
        boot_poll_s=0.25,
        forget_s=0.5,
        probe_s=0.12,
    ),
    device=LdrobotDevice,
    # Models that triangulate send the same packets.
    formats=(PacketFormat,),
    simulated=SIMULATED,
    find_stream=find_stream,
    stream_of=stream_of,
    models=NAMED,
    # The LD14P alone hears anything.
    asked_at=(230_400,),
)
"""The family's row of the registry."""
