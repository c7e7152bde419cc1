"""Scalar reference decoder for the blocks of SCIP 2.0, one character at a time.

Angles are device angles: degrees, clockwise. Only clean streams are understood: `split` raises `ValueError` at
anything but blocks of ``MD`` or ``ME`` whose check characters hold, and skips the response before the first.
"""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import NamedTuple

from tests.reference.samples import Sample


class Field(NamedTuple):
    """What ``PP`` tells."""

    front: int = 384
    turn: int = 1024
    nearest: int = 20
    farthest: int = 5600


URG = Field()


def number(text: str) -> int:
    """Characters of six bits each, the most significant first."""
    value = 0
    for character in text:
        value = value * 64 + ord(character) - 0x30
    return value


def sealed(line: str) -> str:
    """A line with its check character."""
    return line + chr((sum(map(ord, line)) & 0x3F) + 0x30)


def split(raw: bytes) -> list[bytes]:
    """Cut a clean stream into blocks."""
    blocks: list[bytes] = []
    for text in raw.decode("latin-1").removesuffix("\n\n").split("\n\n"):
        echo, status, *lines = text.split("\n")
        if status == "00P" and not blocks and not lines:
            continue
        if echo[:2] not in ("MD", "ME") or status != "99b" or any(sealed(line[:-1]) != line for line in lines):
            raise ValueError(f"no block: {text[:40]!r}")
        blocks.append(text.encode("latin-1") + b"\n\n")
    return blocks


def milliseconds(block: bytes) -> int:
    """The clock of the device in a block."""
    return number(block.decode("latin-1").split("\n")[2][:-1])


def decode(packets: Sequence[bytes], *, field: Field = URG) -> list[Sample]:
    """Decode blocks."""
    samples: list[Sample] = []
    for place, packet in enumerate(packets):
        echo, _, _, *lines = packet.decode("latin-1").rstrip("\n").split("\n")
        text, first = "".join(line[:-1] for line in lines), int(echo[2:6])
        width = 6 if echo.startswith("ME") else 3
        for index in range(int(echo[6:10]) - first + 1):
            far = number(text[width * index : width * index + 3])
            strength = None if width == 3 else min(number(text[width * index + 3 : width * index + 6]), 4095)
            raw_deg = -(first + index - field.front) * 360 / field.turn
            seen = far if field.nearest <= far <= field.farthest else 0
            samples.append(Sample(place, index, raw_deg, raw_deg % 360, float(seen), strength))
    return samples


def revolutions(samples: Iterable[Sample]) -> list[list[Sample]]:
    """Each block is one."""
    return [list(group) for _, group in groupby(samples, lambda sample: sample.packet)]
