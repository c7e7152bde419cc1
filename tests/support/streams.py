"""The measurement streams of every family behind one record, and the way from their bytes to events and scans.

Whatever holds for one format is tested over all of them with the same code: a test takes a `Case`, one per
golden file, and learns from it how its stream is announced, cut, decoded, and what the truth is.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import accumulate, cycle, pairwise
from typing import NamedTuple, Protocol

import pytest

from lidario.families import unasked
from lidario.families.base import Decoder, Stream
from lidario.families.ldrobot.decode import PacketDecoder, TriangleDecoder
from lidario.families.ldrobot.formats import PacketFormat, TriangleFormat
from lidario.families.rplidar import commands as rplidar_commands
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.formats import FORMATS
from lidario.families.ydlidar import commands as ydlidar_commands
from lidario.families.ydlidar.clouds import KINDS as KINDS_OF_CLOUDS
from lidario.families.ydlidar.decode import PointCloudDecoder
from lidario.families.ydlidar.formats import PointCloud
from lidario.model import ScanMode
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scan import Scan
from lidario.wire.blocks import Block, join_blocks, packet_offsets
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor, Event, Packets
from lidario.wire.formats import StreamFormat, Stretch
from lidario.wire.link import Link, LinkState, LinkStats
from tests.reference import golden, ldrobot, rplidar, ydlidar

__all__ = [
    "CASES",
    "KINDS",
    "LAYOUTS",
    "SINGLE_DEG",
    "Assembled",
    "Case",
    "Chunks",
    "Received",
    "Sample",
    "arrived",
    "assembled",
    "before_seam",
    "checked_one_by_one",
    "cut_up",
    "feed",
    "in_one_run",
    "merged",
    "most_or_all",
    "named",
    "open_stream",
    "stream_of",
    "turn_times",
]

Chunks = int | Sequence[int] | None
"""How a stream is cut: pieces of one size, of sizes taken in turns, or not at all."""


class Sample(Protocol):
    """What both scalar references call a sample."""

    @property
    def packet(self) -> int: ...
    @property
    def index(self) -> int: ...
    @property
    def raw_deg(self) -> float: ...
    @property
    def angle_deg(self) -> float: ...
    @property
    def distance_mm(self) -> float: ...
    @property
    def quality(self) -> int | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One golden stream, and all that is particular to its format.

    Attributes:
        name: Name of the golden file.
        response_type: Type byte of the descriptor.
        told: What the device has said of itself before, where a recording cannot be decoded without it.
        descriptor: What the device says before the first packet; empty where it announces nothing.
        make_format: A fresh packet format.
        make_decoder: A fresh decoder.
        request: The request that starts a stream of that format.
        sample_us: Microseconds a sample.
        split: Scalar: a clean stream into its packets.
        decode: Scalar: consecutive packets into samples.
        revolutions: Scalar: samples into whole turns.
        lookahead: Whether a packet is decoded only with the one behind it.
        layout: Of a point cloud: how its samples lie in their bytes.
    """

    name: str
    response_type: int
    descriptor: bytes
    make_format: Callable[[], StreamFormat]
    make_decoder: Callable[[], Decoder]
    request: Callable[[StreamFormat], Request]
    sample_us: float
    split: Callable[[bytes], list[bytes]]
    decode: Callable[[Sequence[bytes]], Sequence[Sample]]
    revolutions: Callable[[Iterable[Sample]], Sequence[Sequence[Sample]]]
    lookahead: bool
    told: bytes = b""
    layout: ydlidar.Kind | None = None

    @property
    def raw(self) -> bytes:
        """The golden bytes; of a stream with other records between its packets, the packets."""
        return _golden(self.name).raw if self.descriptor else b"".join(self.packets)

    @property
    def packets(self) -> tuple[bytes, ...]:
        """The golden packets."""
        return _packets(self)

    @property
    def samples(self) -> tuple[Sample, ...]:
        """All samples, as the scalar reference decodes them."""
        return _samples(self)

    @property
    def turns(self) -> tuple[tuple[Sample, ...], ...]:
        """The whole turns among them."""
        return _turns(self)

    @property
    def truth(self) -> golden.Golden:
        """What the vendor's program made of it."""
        return _golden(self.name)

    @property
    def correction_deg(self) -> float:
        """How far an angle differs from its beam's at most: what the format corrects by the distance."""
        return max(abs((sample.angle_deg - sample.raw_deg + 180) % 360 - 180) for sample in self.samples)

    def intensities(self, samples: Sequence[Sample]) -> list[int] | None:
        """What a scan has of their qualities: the upper eight bits, where the format has more."""
        more = self.layout.intensity_bits - 8 if self.layout is not None else 0
        found = [sample.quality >> max(more, 0) for sample in samples if sample.quality is not None]
        assert len(found) in (0, len(samples))
        return found or None

    @property
    def byte_ns(self) -> float:
        """How long a byte takes at the device's own pace."""
        return len(self.samples) * self.sample_us * 1e3 / len(self.raw)


_golden = cache(golden.load)


@cache
def _packets(case: Case) -> tuple[bytes, ...]:
    return tuple(case.split(case.truth.raw))


@cache
def _samples(case: Case) -> tuple[Sample, ...]:
    return tuple(case.decode(case.packets))


@cache
def _turns(case: Case) -> tuple[tuple[Sample, ...], ...]:
    return tuple(tuple(turn) for turn in case.revolutions(case.samples))


def _rplidar(name: str) -> Case:
    stream = _golden(name)
    answer, sample_us = stream.response_type, stream.sample_us
    assert answer is not None
    assert sample_us is not None
    length = rplidar.PACKET_BYTES[answer] | 1 << 30
    return Case(
        name=name,
        response_type=answer,
        descriptor=b"\xa5\x5a" + length.to_bytes(4, "little") + bytes([answer]),
        make_format=FORMATS[answer],
        make_decoder=DECODERS[answer],
        request=rplidar_commands.scan if answer == 0x81 else partial(rplidar_commands.express_scan, 1),
        sample_us=sample_us,
        split=partial(rplidar.split, answer),
        decode=partial(rplidar.decode, answer),
        revolutions=rplidar.revolutions,  # type: ignore[arg-type]
        lookahead=answer in rplidar.CAPSULE_TYPES,
    )


def _ydlidar(name: str) -> Case:
    return Case(
        name=name,
        response_type=0x81,
        descriptor=bytes.fromhex("A55A0500004081"),
        make_format=PointCloud,
        make_decoder=PointCloudDecoder,
        request=ydlidar_commands.scan,
        sample_us=50.0,
        split=ydlidar.split,
        decode=ydlidar.decode,
        revolutions=ydlidar.revolutions,  # type: ignore[arg-type]
        lookahead=False,
        layout=ydlidar.FOUR_ROS,
    )


_RELATIVES = {
    "x4": (6, "x", ydlidar.Kind(unit=4, triangle=True)),
    "g6": (13, "octave", ydlidar.Kind(unit=2, triangle=True)),
    "g2": (15, "g2", ydlidar.Kind(3, 4, flags=True, intensity_bits=10, triangle=True)),
    "tmini": (150, "tmini", ydlidar.Kind(3, 4, flags=True, intensity_bits=8)),
    "tg15": (100, "tg", ydlidar.Kind()),
}


def _relative(name: str) -> Case:
    code, kind_name, layout = _RELATIVES[name.split("_")[1]]
    kind, sample_us = KINDS_OF_CLOUDS[kind_name], _golden(name).sample_us
    assert sample_us is not None
    return replace(
        _ydlidar(name),
        response_type=kind.response_type,
        told=bytes.fromhex("A55A1400000004") + bytes((code,)) + bytes(19),
        make_format=kind.wire,
        make_decoder=kind.decoder,
        sample_us=sample_us,
        split=partial(ydlidar.split, kind=layout),
        decode=partial(ydlidar.decode, kind=layout),
        layout=layout,
    )


def _ldrobot(name: str) -> Case:
    triangle = "ld14" in name
    sample_us = _golden(name).sample_us
    assert sample_us is not None
    return Case(
        name=name,
        response_type=0x2D if triangle else 0x2C,
        descriptor=b"",
        make_format=TriangleFormat if triangle else PacketFormat,
        make_decoder=TriangleDecoder if triangle else PacketDecoder,
        request=unasked.begin,
        sample_us=sample_us,
        split=ldrobot.split,
        decode=partial(ldrobot.decode, triangle=triangle),
        revolutions=ldrobot.revolutions,  # type: ignore[arg-type]
        lookahead=False,
    )


_OF_GOLDEN_ALONE = ("ldrobot_ld19_13hz", "ldrobot_stl27l_6hz", "ydlidar_g6_12hz", "ydlidar_tg15_12hz")
ALL = (
    *map(_rplidar, golden.RPLIDAR_NAMES),
    *map(_ydlidar, golden.YDLIDAR_NAMES),
    *map(_relative, golden.RELATIVE_NAMES),
    *map(_ldrobot, golden.LDROBOT_NAMES),
)
"""Every golden stream."""
CASES = tuple(case for case in ALL if case.name not in _OF_GOLDEN_ALONE)
"""Those of them that every property is tried on: the others would tell nothing more."""

_KINDS = (
    *(f"rplidar_32k_{answer:x}" for answer in range(0x81, 0x87)),
    "ydlidar_4ros_room10",
    "ydlidar_g2_11hz",
    "ldrobot_ld19_6hz",
    "ldrobot_ld14p_6hz",
)
KINDS = tuple(case for case in CASES if case.name in _KINDS)
"""One stream of each of the formats."""


def _unrecorded(name: str, layout: ydlidar.Kind) -> Case:
    kind = KINDS_OF_CLOUDS[name]
    return replace(
        _ydlidar(f"ydlidar {name}"),
        response_type=kind.response_type,
        make_format=kind.wire,
        make_decoder=kind.decoder,
        sample_us=250.0,
        split=partial(ydlidar.split, kind=layout),
        decode=partial(ydlidar.decode, kind=layout),
        layout=layout,
    )


LAYOUTS = (
    *(case for case in CASES if case.name in ("ydlidar_x4_11hz", "ydlidar_tmini_10hz")),
    _unrecorded("x-flags", ydlidar.Kind(unit=4, flags=True, triangle=True)),
    _unrecorded("octave", ydlidar.Kind(unit=2, triangle=True)),
    _unrecorded("s4b", ydlidar.Kind(3, 4, flags=True, intensity_bits=8, triangle=True)),
    _unrecorded("sh", ydlidar.Kind(4, intensity_bits=16)),
)
"""The other layouts of point clouds, for tests that make packets of any contents; most have no golden stream."""


def named(case: Case) -> str:
    """For `pytest.mark.parametrize(…, ids=named)`."""
    return case.name


def most_or_all(cases: Sequence[Case]) -> pytest.MarkDecorator:
    """Marks a test that takes a `case`: of each format the shortest, and with ``--exhaustive`` all of these."""
    shortest: dict[tuple[str, int], Case] = {}
    for case in sorted(cases, key=lambda case: len(case.raw)):
        shortest.setdefault((case.truth.family, case.response_type), case)
    return pytest.mark.exhaustive("case", sample=list(shortest.values()), full=cases)


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
    request = case.request(case.make_format())
    link.send_request(request)
    assert link.data_to_send() == request.data
    link.receive_data(case.descriptor, 0)
    assert link.state is LinkState.STREAMING
    if not case.descriptor:
        assert link.events_received() == []
        return link
    (event,) = link.events_received()
    assert event == Descriptor(case.descriptor[6], int.from_bytes(case.descriptor[2:5], "little"), True)
    return link


class Received(NamedTuple):
    """What a link made of a stream.

    Attributes:
        events: The events, neighbouring runs joined.
        stats: The link's counters.
        buffered: What it still holds.
    """

    events: list[Event]
    stats: LinkStats
    buffered: int

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


def assembled(case: Case, raw: bytes, chunks: Chunks = 64, times: Callable[[int], int] | None = None) -> Assembled:
    """The scans of a stream whose pieces arrive when the clock says.

    Args:
        case: The stream's format.
        raw: Its bytes.
        chunks: How they are cut.
        times: Arrival of the n-th byte; by default at the device's own pace.
    """
    link, assembler = open_stream(case), Assembler(stream_of(case))
    byte_ns = case.byte_ns
    clock = times or (lambda offset: round(offset * byte_ns))
    scans: list[Scan] = []
    pieces = list(cut_up(raw, chunks))
    for chunk, end in zip(pieces, accumulate(map(len, pieces)), strict=True):
        link.receive_data(chunk, clock(end))
        for event in link.events_received():
            if isinstance(event, Packets):
                scans += assembler.add(event)
    return Assembled(scans, assembler.stats, link.stats)


def turn_times(case: Case) -> list[float]:
    """When each whole turn of the golden stream begins, in nanoseconds since its first sample."""
    first = {(s.packet, s.index): n for n, s in enumerate(case.samples)}
    return [first[turn[0].packet, turn[0].index] * case.sample_us * 1e3 for turn in case.turns]
