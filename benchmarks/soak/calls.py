"""Every question and setting of a session, with values that a user might give, some of which cannot be right."""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable
from typing import Any

import lidario

CALLS: dict[str, Callable[[lidario.Lidar, random.Random], Awaitable[Any]]] = {
    "scan": lambda lidar, _: lidar.scan(),
    "get_info": lambda lidar, _: lidar.get_info(),
    "get_health": lambda lidar, _: lidar.get_health(),
    "get_modes": lambda lidar, _: lidar.get_modes(),
    "get_sample_rate": lambda lidar, _: lidar.get_sample_rate(),
    "get_scan_frequency": lambda lidar, _: lidar.get_scan_frequency(),
    "get_scan_frequency_range": lambda lidar, _: lidar.get_scan_frequency_range(),
    "set_scan_frequency": lambda lidar, draw: lidar.set_scan_frequency(draw.choice((5.0, 7.0, 9.0, 10.0, 99.0))),
    "set_speed_unverified": lambda lidar, draw: lidar.set_scan_frequency(draw.choice((6.0, 8.0)), verify=False),
    "get_zero_offset": lambda lidar, _: lidar.get_zero_offset(),
    "set_zero_offset": lambda lidar, draw: lidar.set_zero_offset(draw.choice((True, False))),
    "set_power_down_protection": lambda lidar, draw: lidar.set_power_down_protection(draw.choice((True, False))),
    "reset": lambda lidar, _: lidar.reset(),
}
"""By its name; the second argument draws the values."""

SPEEDS = ("set_scan_frequency", "set_speed_unverified")
"""Two of these at once contradict each other."""
