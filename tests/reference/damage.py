"""Repeatable damage to byte streams.

The same arguments always do the same harm. Every function says where it struck, and `hit_packets` turns that
into the packets of the undamaged stream that did not arrive whole.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from random import Random
from typing import Literal


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged stream and the places that were touched, ascending, as indices into the undamaged one."""

    raw: bytes
    touched: tuple[int, ...]
    # What an index counts: "byte" = that byte was changed or lost; "gap" = a byte was put in front of it.
    unit: Literal["byte", "gap"]


def flip(raw: bytes, probability: float, seed: int) -> Damage:
    """Turn over one bit of each byte with the given probability."""
    random = Random(seed)
    damaged = bytearray(raw)
    touched = []
    for offset in range(len(raw)):
        if random.random() < probability:
            damaged[offset] ^= 1 << random.randrange(8)
            touched.append(offset)
    return Damage(bytes(damaged), tuple(touched), "byte")


def drop_bytes(raw: bytes, probability: float, seed: int) -> Damage:
    """Lose each byte with the given probability."""
    random = Random(seed)
    touched = [offset for offset in range(len(raw)) if random.random() < probability]
    damaged = bytearray(raw)
    for offset in reversed(touched):
        del damaged[offset]
    return Damage(bytes(damaged), tuple(touched), "byte")


def insert_bytes(raw: bytes, probability: float, seed: int) -> Damage:
    """Put a random byte in front of each byte with the given probability."""
    random = Random(seed)
    damaged = bytearray()
    touched = []
    for offset, byte in enumerate(raw):
        if random.random() < probability:
            damaged.append(random.randrange(256))
            touched.append(offset)
        damaged.append(byte)
    return Damage(bytes(damaged), tuple(touched), "gap")


def hit_packets(damage: Damage, packets: Sequence[bytes]) -> set[int]:
    """Which of the undamaged packets did not arrive whole.

    A byte put in between two packets leaves both whole: it counts for neither.
    """
    starts = [0, *accumulate(len(packet) for packet in packets)]
    hit = set()
    for offset in damage.touched:
        number = bisect_right(starts, offset) - 1
        if damage.unit == "gap" and offset == starts[number]:
            continue
        hit.add(number)
    return hit
