"""What the vendor's rules make of the same bytes, where they are known: of the four formats of capsules.

The rules of the vendor's SDK 2.1.0, written anew: a packet is decoded when the next one comes, its samples at equal
steps from its start angle to that of the next one, whatever is missing between them. Where damage was seen between
two packets, the first is dropped. In 0x85 and 0x86 it is dropped too where the next one begins farther ahead than a
hundred turns a second would carry it. Nothing is told as lost.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from benchmarks.truth_cases import Line
from benchmarks.truth_streams import TrueStream

_FULL_TURN_Q6 = 360 * 64
_OFF_DEG = 1.0
_MARK = re.compile(rb"[\xa0-\xaf][\x50-\x5f]")
_FARTHEST = {0x85: 40, 0x86: 32}
"""By response type: of how many samples a packet is thought to be where it is judged whether the next is too far
ahead."""


def by_vendor(stream: TrueStream, line: Line) -> tuple[int, int] | None:
    """Points of whole revolutions that are kept, and points that are wrong; None where no rules are known."""
    kind, samples = stream.form.kind.mode.response_type, stream.form.samples
    if kind not in (0x82, 0x84, 0x85, 0x86):
        return None
    size, start_at = int(stream.offsets[1]), 8 if kind == 0x86 else 2
    numbers = {
        stream.data[at : at + size].tobytes(): number for number, at in enumerate(stream.offsets[:-1].tolist())
    }
    rate = 1_000_000 // round(stream.form.kind.mode.sample_us)
    farthest_q6 = 64 * (36_000 * _FARTHEST[kind] // rate) if kind in _FARTHEST else 1 << 30
    got, wrong = np.zeros(len(stream.turns), np.bool_), 0
    before: bytes | None = None
    for packet in _packets(line.data.tobytes(), size):
        last, before = before, packet
        if last is None or packet is None:
            continue
        start, end = (int.from_bytes(each[start_at : start_at + 2], "little") & 0x7FFF for each in (last, packet))
        arc = end - start + (_FULL_TURN_Q6 if start > end else 0)
        if arc > farthest_q6:
            continue
        number = numbers.get(last)
        if number is None:
            wrong += samples
            continue
        first = number * samples
        shift = stream.degrees[first : first + samples] - stream.turns[first : first + samples] * 360.0
        degrees = (start + arc * np.arange(samples) / samples) / 64.0 + shift
        right = np.abs((degrees - stream.degrees[first : first + samples] + 180.0) % 360.0 - 180.0) <= _OFF_DEG
        if kind == 0x84 and numbers.get(packet) != number + 1:
            right[-1] = False  # the last distance rests on that of the next packet
        got[first : first + samples] |= right
        wrong += int((~right).sum())
    revolution = np.floor(stream.turns)
    wanted = (revolution >= stream.whole.start) & (revolution < stream.whole.stop)
    return int((got & wanted).sum()), wrong


def _packets(data: bytes, size: int) -> Iterator[bytes | None]:
    """Packets whose check value holds; None where there was damage, of which nothing is looked at again."""
    at = 0
    while True:
        found = _MARK.search(data, at)
        if found is None or found.start() + size > len(data):
            return
        if found.start() != at:
            yield None
        at = found.start() + size
        packet = data[found.start() : at]
        told = (packet[0] & 15) | (packet[1] & 15) << 4
        yield packet if np.bitwise_xor.reduce(np.frombuffer(packet, np.uint8)[2:]) == told else None
