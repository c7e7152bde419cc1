"""Calls that take settings, mounts and clouds, for the tests of wrong arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import lidario
from lidario.merging import MergedScans

__all__ = ["SETTINGS_CALLS"]

CLOUD = np.random.default_rng(1).uniform(-2.0, 2.0, (60, 2))
SETTINGS_CALLS: dict[str, Callable[[Any], Any]] = {
    "merged": lidario.merged,
    "merged(mounts)": lambda value: lidario.merged(mounts=value),
    "merged(motion)": lambda value: MergedScans([lidario.Mount()], value),
    "merged(mode)": lambda value: lidario.merged(mode=value),
    "merged(oldest_s)": lambda value: MergedScans([lidario.Mount()], oldest_s=value),
    "read_config": lidario.read_config,
    "register": lambda value: lidario.register(value, CLOUD),
    "register(second)": lambda value: lidario.register(CLOUD, value),
    "register(guess)": lambda value: lidario.register(CLOUD, CLOUD, guess=value),
    "save_config": lambda value: lidario.save_config(value, "serial"),
    "save_config(serial)": lambda value: lidario.save_config("/dev/null/x", value),
    "save_config(mount)": lambda value: lidario.save_config("/dev/null/x", "serial", mount=value),
    "save_config(filters)": lambda value: lidario.save_config("/dev/null/x", "serial", filters=value),
    "open_lidar(config)": lambda value: lidario.open_lidar("sim://rplidar-s2", config=value),
}
