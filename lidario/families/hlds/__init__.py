"""Hitachi-LG LDS-01 (HLS-LFCD2, HLS-LFCD-LDS, LDS360): the first lidar of the TurtleBot3.

A sample a degree, five revolutions a second. It is started and stopped by letters, to which it responds nothing.
Source: ROBOTIS' driver ``hls_lfcd_lds_driver``; no request and no packet was tried with a device.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from lidario.families.hlds.device import TALKERS
from lidario.families.talking_device import TIMING, family_of

__all__ = ["FAMILY"]

FAMILY: Final = family_of(
    TALKERS,
    "HLDS",
    # One that waits for its letter sends nothing before it turns evenly; no document says how long that takes.
    replace(TIMING, forget_s=0.5, starts_s=2.4),
)
"""The family's row of the registry."""
