"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidario.families.ydlidar import commands as ydlidar_commands
from lidario.families.ydlidar.decode import KINDS as KINDS_OF_CLOUDS
from lidario.families.ydlidar.decode import CloudDecoder
from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.simulated.device import make_simulated
from tests.reference import golden, ydlidar
from tests.support.case import Case, Maker
from tests.support.contents import point_cloud, resealed

MAKER = Maker(make_simulated, "ydlidar-4ros", 1 / 7, obeys=True)
MODELS = ("ydlidar-4ros", "ydlidar-x4", "ydlidar-g2", "ydlidar-tg15", "ydlidar-tmini", "ydlidar-x2", "ydlidar-tx8")


def _ydlidar(name: str) -> Case:
    return Case(
        name=name,
        response_type=0x81,
        descriptor=bytes.fromhex("A55A0500004081"),
        make_format=PointCloud,
        make_decoder=CloudDecoder,
        request=ydlidar_commands.scan,
        sample_us=50.0,
        split=ydlidar.split,
        decode=ydlidar.decode,
        revolutions=ydlidar.revolutions,  # type: ignore[arg-type]
        lookahead=False,
        contents=_contents,
        seal=_sealed,
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
    code, kind, layout = _RELATIVES[name.split("_")[1]]
    sample_us = golden.load(name).sample_us
    assert sample_us is not None
    told = bytes.fromhex("A55A1400000004") + bytes((code,)) + bytes(19)
    return replace(_of_kind(name, kind, layout), told=told, sample_us=sample_us)


def _of_kind(name: str, kind_name: str, layout: ydlidar.Kind) -> Case:
    kind = KINDS_OF_CLOUDS[kind_name]
    return replace(
        _ydlidar(name),
        response_type=kind.response_type,
        make_format=kind.wire,
        make_decoder=kind.decoder,
        sample_us=250.0,
        split=partial(ydlidar.split, kind=layout),
        decode=partial(ydlidar.decode, kind=layout),
        intensity_bits=layout.intensity_bits,
        layout=layout,
    )


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    assert isinstance(case.layout, ydlidar.Kind)
    return [
        point_cloud(
            case.layout,
            int(start),
            int((start + random.integers(0, 3000)) % (0x8000 if wild else 23040)),
            random.bytes(case.layout.sample_bytes * int(random.integers(1, 81))),
            control=int(random.choice([0, 1, 14, 255])),
            marked=bool(random.integers(2)),
        )
        for start in starts
    ]


def _sealed(case: Case, contents: bytes) -> bytes:
    assert isinstance(case.layout, ydlidar.Kind)
    count = (len(contents) - 10) // case.layout.sample_bytes
    return resealed(case.layout, b"\xaa\x55" + contents[2:3] + bytes((count,)) + contents[4:])


CASES = (
    *map(_ydlidar, golden.names_of("ydlidar_4ros")),
    *(_relative(name) for name in golden.names_of("ydlidar") if name.split("_")[1] in _RELATIVES),
)
KINDS = ("ydlidar_4ros_room10", "ydlidar_g2_11hz")
OF_GOLDEN_ALONE = ("ydlidar_g6_12hz", "ydlidar_tg15_12hz")
LAYOUTS = (
    *(case for case in CASES if case.name in ("ydlidar_x4_11hz", "ydlidar_tmini_10hz")),
    _of_kind("ydlidar x-flags", "x-flags", ydlidar.Kind(unit=4, flags=True, triangle=True)),
    _of_kind("ydlidar octave", "octave", ydlidar.Kind(unit=2, triangle=True)),
    _of_kind("ydlidar s4b", "s4b", ydlidar.Kind(3, 4, flags=True, intensity_bits=8, triangle=True)),
    _of_kind("ydlidar sh", "sh", ydlidar.Kind(4, intensity_bits=16)),
)
"""The other layouts of point clouds, for tests that make packets of any contents; most have no golden stream."""
