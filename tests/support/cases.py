"""The measurement streams of every family behind one record.

Whatever holds for one format is tested over all of them with the same code: a test takes a `Case`, one per
golden file, and learns from it how its stream is announced, cut, decoded, and what the truth is.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Literal, Protocol

import pytest

from lidario.families import unasked
from lidario.families.base import Decoder
from lidario.families.ldrobot.device import AXIS, BEAM, TRIANGLE
from lidario.families.rplidar import commands as rplidar_commands
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.formats import FORMATS
from lidario.families.ydlidar import commands as ydlidar_commands
from lidario.families.ydlidar.clouds import KINDS as KINDS_OF_CLOUDS
from lidario.families.ydlidar.decode import PointCloudDecoder
from lidario.families.ydlidar.formats import PointCloud
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat
from tests.reference import golden, ldrobot, rplidar, ydlidar

__all__ = ["ALL", "CASES", "KINDS", "LAYOUTS", "Case", "Sample", "most_or_all", "named"]


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
        return _raw(self)

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
        return _correction_deg(self)

    def intensities(self, samples: Sequence[Sample]) -> list[int] | None:
        """What a scan has of their qualities: the upper eight bits, where the format has more."""
        more = self.layout.intensity_bits - 8 if self.layout is not None else 0
        found = [sample.quality >> max(more, 0) for sample in samples if sample.quality is not None]
        assert len(found) in (0, len(samples))
        return found or None

    @property
    def byte_ns(self) -> float:
        """How long a byte takes at the device's own pace."""
        return _byte_ns(self)


_golden = cache(golden.load)


@cache
def _packets(case: Case) -> tuple[bytes, ...]:
    return tuple(case.split(case.truth.raw))


@cache
def _raw(case: Case) -> bytes:
    return case.truth.raw if case.descriptor else b"".join(case.packets)


@cache
def _byte_ns(case: Case) -> float:
    return len(case.samples) * case.sample_us * 1e3 / len(case.raw)


@cache
def _correction_deg(case: Case) -> float:
    return max(abs((sample.angle_deg - sample.raw_deg + 180) % 360 - 180) for sample in case.samples)


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
    lens: Literal["", "ld08", "ld14"] = "ld14" if "ld14" in name else "ld08" if "ld08" in name else ""
    kind = {"": BEAM, "ld14": TRIANGLE, "ld08": AXIS}[lens]
    sample_us = _golden(name).sample_us
    assert sample_us is not None
    return Case(
        name=name,
        response_type=kind.wire().response_type,
        descriptor=b"",
        make_format=kind.wire,
        make_decoder=kind.decoder,
        request=unasked.begin,
        sample_us=sample_us,
        split=ldrobot.split,
        decode=partial(ldrobot.decode, lens=lens),
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
    "ldrobot_ld08_5hz",
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
