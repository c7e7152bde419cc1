"""The way from the bytes of a `Case` to events and scans."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import accumulate, cycle, pairwise
from typing import NamedTuple

from lidario.basics.model import ScanMode
from lidario.families.base import Stream
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from lidario.wire.blocks import Block, join_blocks, packet_offsets
from lidario.wire.events import Descriptor, Event, Packets
from lidario.wire.formats import StreamFormat, Stretch
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from lidario.wire.stats import LinkStats
from tests.support.cases import Case, Sample

Chunks = int | Sequence[int] | None
"""How a stream is cut: pieces of one size, of sizes taken in turns, or not at all."""
SINGLE_DEG = 2e-5
"""Half a step of single precision just below 360 degrees: what rounding may cost an angle, and no more."""


def before_seam(case: Case, samples: Sequence[Sample], packets: int, seam: int) -> int:
    """Scalar: how many samples of so many packets were measured before the rotor passed `seam` in the last one."""
    degrees = seam * 360 / case.make_format().full_turn
    last = [sample.raw_deg for sample in samples if sample.packet == packets - 1]
    left = 360 - (last[0] - degrees) % 360
    behind = sum(raw - last[0] >= left - 1e-9 for raw in last)
    return sum(sample.packet < packets for sample in samples) - behind


def cut_up(raw: bytes, chunks: Chunks) -> Iterator[bytes]:
    """The stream in pieces."""
    sizes = [len(raw) or 1] if chunks is None else [chunks] if isinstance(chunks, int) else list(chunks)
    at = 0
    for size in cycle(sizes):
        if at >= len(raw):
            return
        yield raw[at : at + size]
        at += size


def arrived(data: bytes, count: int, at_ns: int) -> Packets:
    """Packets of one size that came all in one read."""
    return Packets(data, (Block(len(data) // count, count),), ((count, at_ns),))


def in_one_run(wire: StreamFormat, data: bytes, at_ns: int = 0) -> Packets:
    """Packets of any sizes that came all in one read, whether or not their check values hold."""
    blocks: list[Block] = []
    array, at = bytearray(data), 0
    if wire.shortest == wire.longest:
        assert len(data) % wire.shortest == 0
        blocks, at = [Block(wire.shortest, len(data) // wire.shortest)], len(data)
    while at < len(data):
        size = wire.measure(array, at)
        assert size > 0
        join_blocks(blocks, [Block(size, 1)])
        at += size
    return Packets(data, tuple(blocks), ((sum(block.packets for block in blocks), at_ns),))


def checked_one_by_one(wire: StreamFormat, data: bytearray, at: int) -> Stretch:
    """What `StreamFormat.run` must find, where a packet's check does not depend on the one before."""
    blocks: list[Block] = []
    while len(data) - at >= wire.shortest:
        size = wire.measure(data, at)
        if not 0 < size <= len(data) - at or not wire.intact(data, at, size):
            break
        join_blocks(blocks, [Block(size, 1)])
        at += size
    return Stretch(tuple(blocks), at, at)


def merged(events: Iterable[Event]) -> list[Event]:
    """The same events with neighbouring `Packets` joined; the last arrival counts."""
    result: list[Event] = []
    for event in events:
        if not isinstance(event, Packets):
            result.append(event)
            continue
        data, count, blocks = event.data, event.count, list(event.blocks)
        last = result[-1] if result else None
        if isinstance(last, Packets):
            data, count, blocks = last.data + data, last.count + count, list(last.blocks)
            join_blocks(blocks, event.blocks)
            result.pop()
        result.append(Packets(data, tuple(blocks), ((count, event.received_ns),)))
    return result


def open_stream(case: Case) -> Link:
    """A link that has sent the request and received the descriptor."""
    link = Link()
    link.send_request(case.request(case.make_format()))
    link.receive_data(case.descriptor, 0)
    assert link.state is LinkState.STREAMING
    if not case.descriptor:
        assert link.events_received() == []
        return link
    (event,) = link.events_received()
    assert event == Descriptor(case.descriptor[6], int.from_bytes(case.descriptor[2:5], "little"), True)
    return link


class Received(NamedTuple):
    """What a link made of a stream."""

    events: list[Event]  # the events, neighbouring runs joined
    stats: LinkStats  # the link's counters
    buffered: int  # what it still holds

    @property
    def data(self) -> bytes:
        """The accepted packets, back to back."""
        return b"".join(event.data for event in self.events if isinstance(event, Packets))

    def places(self, case: Case, raw: bytes) -> dict[int, bytes]:
        """Where in `raw`, which it was made of, each accepted packet stood."""
        wire, data, found, at = case.make_format(), bytearray(raw), dict[int, bytes](), 0
        while (stretch := wire.next_stretch(data, at)).end > at:
            for begin, end in pairwise(packet_offsets(stretch.packets)):
                # As the format left them: it may have repaired a bit.
                found[at + begin] = bytes(data[at + begin : at + end])
            at = stretch.end
        assert b"".join(found.values()) == self.data
        return found


def feed(case: Case, raw: bytes, chunks: Chunks = None) -> Received:
    """What a link makes of `raw`, behind its descriptor."""
    link = open_stream(case)
    events: list[Event] = []
    for chunk in cut_up(raw, chunks):
        link.receive_data(chunk, 0)
        events += link.events_received()
    return Received(merged(events), link.stats, link.buffered)


def stream_of(case: Case, **changes: object) -> Stream:
    """The stream as its family would describe it to the session."""
    about: dict[str, object] = {
        "format": case.make_format(),
        "decoder": case.make_decoder(),
        "mode": ScanMode(1, "mode of the case", case.sample_us, 0.0, case.response_type),
        "sample_ns": case.sample_us * 1e3,
        "spin_up_s": 5.0,
        "slowest_turn_s": 1.0,
    }
    return Stream(**(about | changes))  # type: ignore[arg-type]


class Assembled(NamedTuple):
    """What link and assembler made of a stream."""

    scans: list[Scan]
    stats: AssemblerStats
    link: LinkStats


def assembled(case: Case, raw: bytes, chunks: Chunks = 251, times: Callable[[int], int] | None = None) -> Assembled:
    """The scans of a stream whose n-th byte arrives when `times` says, by default at the device's own pace.

    By default it is cut so that packets of every format are cut anywhere.
    """
    pipeline = Pipeline(stream_of(case), link=open_stream(case))
    byte_ns = case.byte_ns
    clock = times or (lambda offset: round(offset * byte_ns))
    scans: list[Scan] = []
    pieces = list(cut_up(raw, chunks))
    for chunk, end in zip(pieces, accumulate(map(len, pieces)), strict=True):
        scans += pipeline.receive(chunk, clock(end))
    return Assembled(scans, pipeline.stats, pipeline.link.stats)
