"""Calls that take settings, mounts and clouds, for the tests of wrong arguments."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import lidario
from lidario.merging import Merged, MergedScans

__all__ = ["SETTINGS_CALLS"]

CLOUD = np.random.default_rng(1).uniform(-2.0, 2.0, (60, 2))
LAID = lidario.Registration(lidario.Mount(), 0.01, 1.0, 0.0)
EMPTY = np.zeros((0, 2), np.float32)
SEEN = Merged(lidario.merge(), 0, 0, 0.1, (), 12.0, EMPTY, EMPTY)
OF_LASERSCAN = ("beams", "frame_id", "range_min", "range_max", "no_return", "filtered")


def laserscan(name: str, value: Any) -> object:
    return SEEN.to_laserscan(**{name: value})


SETTINGS_CALLS: dict[str, Callable[[Any], Any]] = {
    "looseness": lambda value: lidario.looseness(value, CLOUD, LAID),
    "looseness(second)": lambda value: lidario.looseness(CLOUD, value, LAID),
    "looseness(found)": lambda value: lidario.looseness(CLOUD, CLOUD, value),
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
    "save_config(without)": lambda value: lidario.save_config("/dev/null/x", "serial", without=value),
    "open_lidar(config)": lambda value: lidario.open_lidar("sim://rplidar-s2", config=value),
    **{f"Merged.{name}": partial(laserscan, name) for name in OF_LASERSCAN},
}
