"""Listening before anything is written: a device that streams already tells its family and its speed by that.

It streams because a program that used it was killed. Asking at speeds that are not its own would be in vain for a
second or more, and what it sends meanwhile hides its responses. Packets carry check values, so some of them in a
row are no chance, and at a wrong speed there are none.

Where nothing at all arrives at one speed, nothing streams at any: a receiver at a wrong speed hears garbage, not
silence. So a device at rest is listened to once, and only a device that streams at every speed.

Which lidar was found last behind which USB adapter is remembered, so that it is tried first when its port is
opened again. An adapter is known by its name in ``/dev/serial/by-id``, which contains its serial number. Names such
as ``/dev/ttyUSB0`` are given anew with each plugging in, so nothing is kept for them. It is kept in the process,
not in a file: a library does not write to a user's folders unasked, a file may be stale or belong to another user,
and what it would save is one round of listening, a second at most, once in a program.
"""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from lidario.basics.model import LineErrors
from lidario.basics.source import Source, quoted
from lidario.basics.words import counted
from lidario.errors import ConnectFailed
from lidario.families.base import Family
from lidario.families.registry import FAMILIES
from lidario.port.port import Port
from lidario.wire.formats import StreamFormat

if TYPE_CHECKING:
    from lidario.session.finding.asking import Attempt

BY_ID: Final = Path("/dev/serial/by-id")
"""Where adapters have names that last."""
LAST_AT: Final[dict[str, tuple[str, int]]] = {}
"""Adapter -> name of the family and speed of the lidar that was found last behind it."""
LISTEN_S = 0.12
"""At each speed. The slowest packets are 19 ms apart (0x84 of a model for 2000 samples a second)."""
STEP_S = 0.03
"""How often it is tried to recognise what has come; it takes some milliseconds where it is garbage."""
KEPT = 4096
"""Bytes that are tried, the latest: five of the longest packets (781 bytes), so more would tell nothing else."""
_KEPT_OF_WHOLE = 16384
"""The same where each packet is a whole scan, of up to 6.8 KB: among these is one from its beginning on."""
_PACKETS = 3
"""So many, or one that is a whole scan: it has a check value in each of its lines."""
_SHARE = 0.5
"""Part of the bytes that must be whole packets. The first and the last one of three are mostly incomplete."""
_MOSTLY = 0.9
_TEXT: Final = re.compile(rb"([\t\x20-\x7e]{16,})\r?\n")
"""A line of text. Among 4096 random bytes one stands by chance in one case of 300 thousand."""


class Heard(NamedTuple):
    """What listening told."""

    # Whose packets came, and at which speed (0 where the line has none); None where none were recognised.
    stream: tuple[Family, int] | None
    silent: bool  # nothing came at all


async def listen(port: Port, tries: Sequence[Attempt]) -> Heard:
    """Recognise a stream of one of those families, at one of those speeds. Writes nothing.

    It takes 0.12 s where nothing arrives, and at most as long for each speed where something does. Cancelling it
    leaves the port open.
    """
    families = list(dict.fromkeys(each.family for each in tries))
    for speed in dict.fromkeys(each.baudrate for each in tries):
        try:
            port.set_baudrate(speed)
        except ConnectFailed:
            continue  # the adapter cannot do it
        heard = bytearray()

        def keep(direction: str, data: bytes, now: int, heard: bytearray = heard) -> None:  # noqa: ARG001
            if direction == "in":
                heard += data
                # The first bytes may still have been received at the speed before.
                del heard[:-_KEPT_OF_WHOLE]

        port.add_tap(keep)
        try:
            family = await _recognise(port, heard, families)
        finally:
            port.remove_tap(keep)
        if family is not None:
            return Heard((family, speed), silent=False)
        if not heard:
            return Heard(None, silent=True)
    return Heard(None, silent=False)


async def _recognise(port: Port, heard: bytearray, families: Sequence[Family]) -> Family | None:
    loop = asyncio.get_running_loop()
    deadline = loop.time() + LISTEN_S
    while port.is_open and loop.time() < deadline:
        await asyncio.sleep(min(STEP_S, deadline - loop.time()))
        family = family_of_stream(heard, families)
        if family is not None:
            return family
    return None


def family_of_stream(data: bytearray, families: Sequence[Family] = FAMILIES) -> Family | None:
    """Whose packets most of `data` are; None where there are no more than two in a row, or mostly other bytes.

    Where each packet is a whole scan, one will do.
    """
    best, family = _SHARE, None
    # Copies: it grows, and parsers have views of what they read, which others may keep, as `Link` knows.
    data, latest = data.copy(), data[-KEPT:]
    for each in families:
        for kind in each.formats:
            wire = kind()
            tried = data if wire.whole else latest
            packets, found = wire.packets_in(tried)
            share = len(found) / max(1, len(tried))
            if packets >= (1 if wire.whole else _PACKETS) and share > best:
                best, family = share, each
    return family


def _idle_family(data: bytearray) -> Family | None:
    """Whose packets are among the bytes that say of themselves that they measure nothing: the rotor is too slow."""
    return next((each for each in FAMILIES if any(_has_records(data, kind()) for kind in each.formats)), None)


def _has_records(data: bytearray, wire: StreamFormat) -> bool:
    return any(wire.other_record(data, found.start()) > 0 for found in wire.header.finditer(data))


def _text_in(data: bytearray) -> str:
    """The longest line of text among the bytes; empty where there is none."""
    return max(_TEXT.findall(data), key=len, default=b"").decode("ascii").strip()


def adapter_of(path: str) -> str | None:
    """The lasting name of the adapter behind a port; None where it has none. Reads a folder: under 1 ms."""
    try:
        real = os.path.realpath(path)
        return next((link.name for link in BY_ID.iterdir() if os.path.realpath(link) == real), None)
    except OSError:
        return None


class ReceivedInSilence:
    """A tap that keeps the first bytes received while no response arrives."""

    def __init__(self) -> None:
        self.total: int = 0  # bytes received
        self._kept = bytearray()

    def see(self, direction: str, data: bytes, now: int) -> None:  # noqa: ARG002
        """Count what came in, and keep its beginning."""
        if direction == "in":
            self.total += len(data)
            self._kept += data[: KEPT - len(self._kept)]

    def describe(self, errors: LineErrors, *, has_speed: bool = True) -> str:
        """In words: nothing, zeros, packets of some family, text, or garbage; a network has no wrong baud rate."""
        if not self.total:
            return "nothing came back"
        received = counted(self.total, "byte")
        if self._kept.count(0) >= _MOSTLY * len(self._kept):
            return f"{received} came back, nearly all zero, as from a line that floats or a wrong baud rate"
        family = family_of_stream(self._kept)
        if family is not None:
            return f"{received} came back, {family.title} packets among them: it streams, but does not obey"
        family = _idle_family(self._kept)
        if family is not None:
            return f"{received} came back, {family.title} packets among them, which measure nothing"
        if text := _text_in(self._kept):
            return f"{received} came back, text among them: {quoted(text)}"
        if told := errors.meaning():
            return f"{received} of garbage came back, with {told}"
        why = "at a wrong baud rate" if has_speed else "from no lidar"
        return f"{received} of garbage came back, as {why}"

    def nothing_responds(
        self, source: Source, asked: Sequence[Family], speeds: Sequence[int], errors: LineErrors
    ) -> ConnectFailed:
        """The error that says who was asked, at which speeds in baud, and what came back; and a cure."""
        told = list(dict.fromkeys(str(speed) for speed in speeds))
        at = f" at {_either(told)} baud" if told and source.kind == "serial" else ""
        titles = _either(list(dict.fromkeys(each.title for each in asked)))
        cure = "Is the lidar powered (5 V, 1.5 A)"
        cure += ", and is this computer in its network" if source.kind == "udp" else ""
        cure += " and the adapter's speed switch right?" if source.kind == "serial" else "?"
        # Behind a serial line that is served over TCP there may be a wrong baud rate, too.
        errors = errors if len(told) == 1 else LineErrors()
        said = self.describe(errors, has_speed=source.kind != "udp")
        heard = family_of_stream(self._kept)
        if source.model is not None and heard is not None and heard in asked:
            said = f"{self.total} bytes came back, {heard.title} packets among them, but of another model than"
            said, cure = f"{said} {quoted(source.model)}", "Is ?model= right?"
        elif heard is None and _idle_family(self._kept) is not None:
            cure = "Does its motor turn, and at the right speed?"
        elif heard is None and _text_in(self._kept):
            cure = (
                "Is that a lidar? One that says so again and again restarts: is its supply too weak (5 V, 1.5 A)?"
            )
        return ConnectFailed(
            f"{source.address or source.text} opened, but nothing responds{at} (asked as {titles}): {said}. {cure}",
            reason="silent",
        )


def _either(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
