"""Which scan mode runs, when readers ask for one by name, by id, or for none in particular."""

import math
from numbers import Integral
from typing import NamedTuple

from lidario.basics.arguments import shown
from lidario.basics.model import ScanMode
from lidario.errors import Unsupported
from lidario.families.base import Device
from lidario.session.streaming.forecast import BITS_A_BYTE


class Wanted(NamedTuple):
    """A stream that ought to run."""

    mode: ScanMode
    force: bool  # whether the device shall measure even when the motor is not up to speed


def does_not_fit(device: Device, modes: tuple[ScanMode, ...], mode: ScanMode, baudrate: int) -> str:
    """Why the line cannot carry what a mode sends, and the cure; empty where it can, or nothing is known."""
    load = device.load(mode)
    # What is not known is neither more nor less.
    if not (baudrate and load * BITS_A_BYTE > baudrate):
        return ""
    slower = " or ".join(repr(each.name) for each in modes if device.load(each) * BITS_A_BYTE <= baudrate)
    instead = f", or choose {slower}" if slower else ""
    return (
        f"scan mode {mode.name!r} sends {load:.0f} bytes a second, and a line of {baudrate} baud carries "
        f"{baudrate // BITS_A_BYTE}: have the line at {math.ceil(load * BITS_A_BYTE)} baud or more{instead}"
    )


def choose_mode(modes: tuple[ScanMode, ...], wanted: str | int | None) -> ScanMode:
    """The mode of that name or id; the device's typical one for None.

    Raises:
        Unsupported: There is no such mode; the text lists the modes of the device.
    """
    number: object = wanted  # whole numbers of numpy are none of Python's
    for mode in modes:
        if wanted is None and mode.typical:
            return mode
        if isinstance(wanted, str) and mode.name.casefold() == wanted.casefold():
            return mode
        if isinstance(number, Integral) and mode.id == number:
            return mode
    if wanted is None:
        return modes[0]
    # Modes that the device does not list have the id of another one, which an id then means.
    by_id = {mode.id: mode for mode in reversed(modes)}
    known = ", ".join(f"{mode.name} ({mode.id})" if by_id[mode.id] is mode else mode.name for mode in modes)
    raise Unsupported(f"this device has no scan mode {shown(wanted)}; it has {known}")
