"""Repeatable damage to byte streams.

The same arguments always do the same harm. Every function says where it struck.
"""

from dataclasses import dataclass
from random import Random


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged stream and the places that were touched, ascending, as indices into the undamaged one."""

    raw: bytes
    touched: tuple[int, ...]


def flip(raw: bytes, probability: float, seed: int) -> Damage:
    """Turn over one bit of each byte with the given probability."""
    random = Random(seed)
    damaged = bytearray(raw)
    touched = []
    for offset in range(len(raw)):
        if random.random() < probability:
            damaged[offset] ^= 1 << random.randrange(8)
            touched.append(offset)
    return Damage(bytes(damaged), tuple(touched))


def drop_bytes(raw: bytes, probability: float, seed: int) -> Damage:
    """Lose each byte with the given probability."""
    random = Random(seed)
    touched = [offset for offset in range(len(raw)) if random.random() < probability]
    damaged = bytearray(raw)
    for offset in reversed(touched):
        del damaged[offset]
    return Damage(bytes(damaged), tuple(touched))


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
    return Damage(bytes(damaged), tuple(touched))
