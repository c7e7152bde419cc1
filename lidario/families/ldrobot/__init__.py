"""LDROBOT LD06, LD19, STL-06P, STL-19P, STL-26, STL-27L, LD08, LD14 and LD14P.

Sources throughout: the LD06 development manual v1.0, the vendor's SDKs, and a recording of a real LD06, from which
sample rate and unsteadiness are known. All but one model only talk; no request was tried on a real device.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from lidario.families.ldrobot.device import TALKERS
from lidario.families.talking_device import TIMING, family_of

__all__ = ["FAMILY"]

FAMILY: Final = family_of(
    TALKERS,
    "LDROBOT",
    # Packets come every 5 ms at most. After power-up the first ones come within 0.7 s.
    replace(TIMING, quiet_s=0.05, forget_s=0.5),
)
"""The family's row of the registry."""
