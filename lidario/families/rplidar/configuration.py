"""What an RPLIDAR tells of itself when it is asked value by value (GET_LIDAR_CONF), first of all its scan modes.

S-series interface manual, GET_LIDAR_CONF. Every value comes in a response of its own, and each of them can be lost
or damaged. So each is asked until it came twice alike; after four that came not at all or never alike, no more are
asked.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from lidario.arguments import printable
from lidario.errors import RemoteProtocolError, ResponseTimeout
from lidario.families.base import Script
from lidario.families.responses import agreed
from lidario.families.rplidar import commands
from lidario.families.rplidar.commands import Conf
from lidario.families.rplidar.formats import FORMATS
from lidario.model import ScanMode

MODE_LIMIT: Final = 64
"""Mode numbers that are tried; devices have two to five modes, numbered from 0, with holes."""
SHORT_S: Final = 0.15
"""A healthy device responds within a few milliseconds."""
MOST_IN_VAIN: Final = 4
"""Questions that were not told, after which no more are asked. A silence takes 1 s."""


class Configuration:
    """The values of one device; it is asked for none while `known` is False."""

    def __init__(self) -> None:
        self.known = False
        self._in_vain = 0

    def ask_bytes(self, kind: Conf, mode: int | None = None, *, shortly: bool = False) -> Script[bytes | None]:
        """One value; empty where the device does not have it, None where it does not tell it.

        One that was silent before may not know the question: it is asked `shortly`, and no stream waits for long.
        """
        if not self.known:
            return b""
        if self._in_vain >= MOST_IN_VAIN:
            return None
        request = commands.get_lidar_conf(kind, mode)
        if shortly:
            request = replace(request, timeout=SHORT_S, attempts=1)
        try:
            told = yield request
            # That it knows no such value is told by a response that is shorter: no damage makes that.
            return (yield from agreed(request, told))[4:] if told[4:] else b""
        except (ResponseTimeout, RemoteProtocolError):
            self._in_vain += 1
            return None

    def modes(self) -> Script[tuple[tuple[ScanMode, ...], str]]:
        """The modes that it lists, by number, and what is to be said of those that it did not tell."""
        self._in_vain = 0
        try:
            return (yield from self._modes())
        finally:
            self._in_vain = 0

    def _modes(self) -> Script[tuple[tuple[ScanMode, ...], str]]:
        found: dict[int, ScanMode] = {}
        count = (yield from self._ask("<H", Conf.MODE_COUNT)) or 0
        unsure = yield from self._list(range(MODE_LIMIT), count, found)
        # The line may have damaged what was not told.
        unsure = yield from self._list(unsure, count, found)
        if not found:
            return (), "the device did not tell its scan modes; those of older firmware are assumed"
        typical = yield from self._ask("<H", Conf.TYPICAL_MODE)
        if typical is None:
            typical = yield from self._ask("<H", Conf.TYPICAL_MODE)
        modes = [found[number] for number in sorted(found)]
        usable = [mode.id for mode in modes if mode.response_type in FORMATS]
        if typical not in usable:
            typical = usable[-1] if usable else None
        is_short = len(found) < count or bool(found.keys() & unsure)
        note = "the device did not tell all of its scan modes" if is_short else ""
        return tuple(replace(mode, typical=mode.id == typical) for mode in modes), note

    def _list(self, numbers: Iterable[int], count: int, found: dict[int, ScanMode]) -> Script[list[int]]:
        """Ask for modes until so many are found; returns the numbers of those that have left a question open."""
        unsure: list[int] = []
        for number in numbers:
            in_vain = self._in_vain
            if in_vain >= MOST_IN_VAIN or (number not in found and len(found) >= count):
                continue
            told = yield from self._mode(number)
            # Numbers may have holes: a mode that the device tells nothing of is none.
            if told.response_type:
                found[number] = told
            if self._in_vain > in_vain:
                unsure.append(number)
        return unsure

    def _mode(self, mode: int) -> Script[ScanMode]:
        response_type = yield from self._ask("<B", Conf.RESPONSE_TYPE, mode)
        if not response_type:
            return ScanMode(mode, "", 0.0, 0.0, 0)
        name = (yield from self.ask_bytes(Conf.MODE_NAME, mode)) or b""
        sample_q8 = yield from self._ask("<I", Conf.SAMPLE_DURATION, mode)
        distance_q8 = yield from self._ask("<I", Conf.MAX_DISTANCE, mode)
        return ScanMode(
            id=mode,
            name=_text(name) or f"mode {mode}",
            sample_us=(sample_q8 or 0) / 256,
            max_distance=(distance_q8 or 0) / 256,
            response_type=response_type,
        )

    def _ask(self, layout: str, kind: Conf, mode: int | None = None) -> Script[int | None]:
        """One number, or None when the device does not have or tell it."""
        value = yield from self.ask_bytes(kind, mode)
        if value is None or len(value) < struct.calcsize(layout):
            return None
        return int(struct.unpack_from(layout, value)[0])


def _text(raw: bytes) -> str:
    """A name from the device, without what could disturb a terminal."""
    return printable(raw.split(b"\0")[0].decode("utf-8", "replace")).strip()
