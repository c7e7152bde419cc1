"""Camsense X1, and the LDS08RR of the same kind: turrets of robot vacuums, sold bare.

They turn and stream for as long as they have power, and hear nothing. Sources: Camsense's ``T2SDK``, 47 packets
of a real X1 (github.com/thijses/camsense-X1), community ports.
"""

from __future__ import annotations

from typing import Final

from lidario.families.camsense.device import TALKERS
from lidario.families.talking_device import family_of

__all__ = ["FAMILY"]

FAMILY: Final = family_of(TALKERS, "Camsense")
"""The family's row of the registry."""
