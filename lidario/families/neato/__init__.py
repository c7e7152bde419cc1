"""Neato XV-11 (the lidar of the vacuums XV-11 to Botvac), and the LDS01RR and LDS02RR of Xiaomi and Roborock.

They stream for as long as their rotor turns, and hear nothing. The host powers the motor by wires of its own and so
decides about the speed, which no request can do: what is measured is told. Sources: firmware 2.4 as documented by
the XV-11 hacking wiki and community ports; a recording of a real XV-11 (github.com/Xevel/NXV11); the specification
of the LDS01RR. The pre-production firmware 2.1, which has no check value, is not supported, nor are the frames
``E7 7E`` of the board that the LDS01RR is sold with.
"""

from __future__ import annotations

from typing import Final

from lidario.families.base import Family, Timing
from lidario.families.neato.device import TALKERS
from lidario.families.neato.formats import BackFormat, PacketFormat

__all__ = ["FAMILY"]

SIMULATED: Final = ("neato-xv11", "neato-lds02rr", "neato-lds01rr")
"""The names of `simulated.device.PROFILES`, repeated: users of a real device do not load the simulated one."""

FAMILY: Final = Family(
    name="neato",
    title="Neato",
    baudrates=(115_200,),
    timing=Timing(
        # At 200 revolutions a minute a packet takes 3.3 ms, and a USB adapter may hold bytes back for 16 ms.
        quiet_s=0.05,
        drain_s=0.5,
        # It cannot be restarted from here; the rotor takes its time after the text that a boot prints.
        boot_s=3.0,
        boot_poll_s=0.25,
        # It hears nothing. One that has just been given power sends a second or two later.
        forget_s=3.0,
        probe_s=0.12,
    ),
    device=TALKERS.device,
    formats=(BackFormat, PacketFormat),
    simulated=SIMULATED,
    find_stream=TALKERS.find_stream,
    stream_of=TALKERS.stream_of,
    models=TALKERS.named,
    # It only talks: nothing is asked at any speed.
    asked_at=(),
)
"""The family's row of the registry."""
