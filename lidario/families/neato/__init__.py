"""Neato XV-11 (the lidar of the vacuums XV-11 to Botvac), and the LDS01RR and LDS02RR of Xiaomi and Roborock.

They stream for as long as their rotor turns, and hear nothing. The host powers the motor by wires of its own and so
decides about the speed, which no request can do: what is measured is told. Sources: firmware 2.4 as documented by
the XV-11 hacking wiki and community ports; a recording of a real XV-11 (github.com/Xevel/NXV11); the specification
of the LDS01RR. The pre-production firmware 2.1, which has no check value, is not supported, nor are the frames
``E7 7E`` of the board that the LDS01RR is sold with.
"""

from __future__ import annotations

from typing import Final

from lidario.families.neato.device import TALKERS
from lidario.families.talking_device import family_of

__all__ = ["FAMILY"]

FAMILY: Final = family_of(TALKERS, "Neato")
"""The family's row of the registry."""
