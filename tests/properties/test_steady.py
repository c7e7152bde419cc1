"""Revolutions decoded together are those decoded one after the other: every sample, every time, every count.

The reference is the same `Assembler` with blocks switched off. Streams are two seconds long, come in pieces of any
size, each of one read or of several, and are damaged anywhere: bits flipped, bytes lost or added, pieces of stream
missing or repeated, late stamps.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.streams import KINDS, Kind, recording
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scans.scan import Scan
from lidario.wire.events import Packets
from lidario.wire.link import Link

every_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))


class Made(NamedTuple):
    """What became of a stream."""

    scans: list[Scan]
    stats: AssemblerStats
    blocks: int


@cache
def stream_of(kind: Kind) -> bytes:
    """Two seconds of packets, about twenty revolutions."""
    played = recording(kind)
    return played.head + played.loop


def made(
    kind: Kind,
    data: bytes,
    chunk: int,
    *,
    by_blocks: bool,
    baudrate: int,
    offset: float,
    late: frozenset[int],
    read: int,
) -> Made:
    """Decode in pieces of `chunk` bytes; those with the numbers `late` come 0.4 s after their time.

    Each piece is of reads of `read` bytes; with 0, of one.
    """
    stream = replace(kind.stream(), zero_offset_deg=offset)
    link, assembler = Link(), Assembler(stream, baudrate)
    link.enter_stream(stream.format)
    scans: list[Scan] = []
    blocks = 0
    with pytest.MonkeyPatch.context() as patch:
        add_block = Assembler.add_block

        def counted(self: Assembler, *args: object) -> list[Scan]:
            nonlocal blocks
            found = add_block(self, *args) if by_blocks else []  # type: ignore[arg-type]
            blocks += bool(found)
            return found

        patch.setattr(Assembler, "add_block", counted)
        now = 0
        for number, at in enumerate(range(0, len(data), chunk)):
            # What comes behind what is late is not read before it.
            now = max(now, round(min(at + chunk, len(data)) * byte_ns(kind)) + 400_000_000 * (number in late))
            piece = data[at : at + chunk]
            reads = range(read, len(piece), read) if read else ()
            arrivals = [(size, now - round((len(piece) - size) * byte_ns(kind))) for size in reads]
            link.receive_data(piece, now, arrivals)
            for event in link.events_received():
                if isinstance(event, Packets):
                    scans += assembler.add(event)
    return Made(scans, assembler.stats, blocks)


@cache
def byte_ns(kind: Kind) -> float:
    return 1e9 / len(recording(kind).loop)


def assert_same(block: Made, careful: Made) -> None:
    assert block.stats == careful.stats
    assert len(block.scans) == len(careful.scans)
    for one, other in zip(block.scans, careful.scans, strict=True):
        for name in ("device_angles", "device_distances", "intensities"):
            first, second = getattr(one, name), getattr(other, name)
            assert (first is None) == (second is None)
            if first is not None:
                assert first.dtype == second.dtype
                assert not first.flags.writeable
                np.testing.assert_array_equal(first, second)
        for name in ("stamp_ns", "wall_stamp_ns", "time_increment_ns", "duration_ns", "rpm", "seq", "lost_packets"):
            np.testing.assert_equal(getattr(one, name), getattr(other, name), err_msg=name)


def compared(
    kind: Kind,
    data: bytes,
    chunk: int,
    *,
    baudrate: int = 0,
    offset: float = 0.0,
    late: frozenset[int] = frozenset(),
    read: int = 0,
) -> Made:
    block, careful = (
        made(kind, data, chunk, by_blocks=way, baudrate=baudrate, offset=offset, late=late, read=read)
        for way in (True, False)
    )
    assert careful.blocks == 0
    assert_same(block, careful)
    return block


@every_kind
@pytest.mark.exhaustive(
    ("chunk", "read"),
    sample=[(1 << 20, 731), (50_001, 0), (2_000, 731)],
    full=list(product([1 << 20, 50_001, 2_000], [0, 731])),
)
def test_a_clean_stream_is_decoded_in_blocks(kind: Kind, chunk: int, read: int) -> None:
    block = compared(kind, stream_of(kind), chunk, read=read)
    assert block.blocks > (len(block.scans) // 2 if chunk == 2_000 else 0)
    assert len(block.scans) >= 10
    assert block.stats.lost_packets == block.stats.missed_scans == 0


@every_kind
def test_line_and_zero_offset_are_the_same(kind: Kind) -> None:
    compared(kind, stream_of(kind), 1 << 20, baudrate=1_000_000, offset=123.4)


@st.composite
def damages(draw: st.DrawFn, data: bytes) -> bytes:
    """The stream, damaged at up to four places, anywhere."""
    spoiled = bytearray(data)
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(spoiled) - 1))
        how = draw(st.sampled_from(["flip", "lose", "add", "miss", "repeat"]))
        if how == "flip":
            spoiled[at] ^= 1 << draw(st.integers(0, 7))
        elif how == "lose":
            del spoiled[at : at + draw(st.integers(1, 300))]
        elif how == "add":
            spoiled[at:at] = draw(st.binary(min_size=1, max_size=100))
        elif how == "miss":
            del spoiled[at : at + draw(st.integers(1000, 20_000))]
        else:
            spoiled[at:at] = spoiled[max(0, at - draw(st.integers(100, 10_000))) : at]
    return bytes(spoiled)


def _chunks() -> Iterator[st.SearchStrategy[int]]:
    yield st.integers(500, 70_000)
    yield st.just(1 << 20)


@pytest.mark.long
@every_kind
@given(st.data())
def test_damage_is_told_the_same(kind: Kind, data: st.DataObject) -> None:
    spoiled = data.draw(damages(stream_of(kind)), "stream")
    chunk = data.draw(st.one_of(*_chunks()), "chunk")
    late = frozenset(data.draw(st.sets(st.integers(0, 12), max_size=3), "late"))
    read = data.draw(st.sampled_from([0, 300, 1111]), "read")
    compared(kind, spoiled, chunk, baudrate=data.draw(st.sampled_from([0, 1_000_000])), late=late, read=read)


@every_kind
def test_what_follows_a_damaged_place_is_decoded_in_blocks_again(kind: Kind) -> None:
    data = bytearray(stream_of(kind))
    del data[len(data) // 2 : len(data) // 2 + 1000]
    block = compared(kind, bytes(data), 1 << 20)
    assert block.blocks >= 1
    assert block.stats.lost_packets > 0


@pytest.mark.parametrize("share", [0.15, 0.2263, 0.31])
@every_kind
def test_a_late_read_behind_damage_is_told_the_same(kind: Kind, share: float) -> None:
    """Packets decoded together told nothing of the speed: each was then taken for one of two, for good."""
    data = bytearray(stream_of(kind))
    data[int(share * len(data))] ^= 1
    compared(kind, bytes(data), 22_722, late=frozenset({2}))
