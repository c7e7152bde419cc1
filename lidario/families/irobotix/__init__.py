"""Delta-2A, 2B, 2D and 2G of 3irobotix (Shanchuan), and the LDS08RR of the same kind: turrets of robot vacuums.

They stream for as long as their rotor turns, and hear nothing. The host powers the motor by wires of its own, so no
request sets the speed; what is measured is told. Sources: 3irobotix's SDK 1.7.1 and protocol documents, community
ports; nothing was tried with a device.
"""

from __future__ import annotations

from typing import Final

from lidario.families.irobotix.device import TALKERS
from lidario.families.talking_device import family_of

__all__ = ["FAMILY"]

FAMILY: Final = family_of(TALKERS, "3irobotix")
"""The family's row of the registry."""
