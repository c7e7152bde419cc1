"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidario.families.hokuyo.decode import BlockDecoder
from lidario.families.hokuyo.formats import DistanceFormat, StrengthFormat
from lidario.families.hokuyo.geometry import Geometry
from lidario.families.hokuyo.simulated import make_simulated
from lidario.families.scripts import begin
from tests.reference import golden, hokuyo
from tests.support.case import Case, Maker

MAKER = Maker(make_simulated, "hokuyo-urg04lx", 0.1, obeys=True, tuned=False)
MODELS = ("hokuyo-ust10lx", "hokuyo-utm30lx")
GEOMETRY = Geometry(44, 725, 384, 1024, 20, 5600, 600)


def _case(name: str, kind: type[DistanceFormat] = DistanceFormat) -> Case:
    return Case(
        name=name,
        response_type=kind.response_type,
        descriptor=b"",
        make_format=partial(kind, GEOMETRY),
        make_decoder=partial(BlockDecoder, kind, GEOMETRY),
        request=begin,
        sample_us=GEOMETRY.sample_us,
        split=hokuyo.split,
        decode=hokuyo.decode,
        revolutions=hokuyo.revolutions,
        lookahead=False,
        contents=_contents,
        seal=_sealed,
        exact=True,
        intensity_bits=12 if kind is StrengthFormat else 8,
    )


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    word, width = ("MD", 3) if case.response_type == DistanceFormat.response_type else ("ME", 6)
    made: list[bytes] = []
    for _ in starts:
        digits = random.integers(0x30, 0x70, 4 + GEOMETRY.steps * width).astype(np.uint8).tobytes().decode()
        lines = [digits[:4], *(digits[at : at + 64] for at in range(4, len(digits), 64))]
        body = "\n".join(map(hokuyo.sealed, ["99", *lines]))
        made.append(f"{word}{GEOMETRY.first:04}{GEOMETRY.last:04}01000\n{body}\n\n".encode())
    return made


def _sealed(case: Case, contents: bytes) -> bytes:
    return _contents(case, np.random.default_rng(list(contents[:16])), np.zeros(1, np.int64), False)[0]


CASES = tuple(map(_case, golden.names_of("hokuyo")))
# What all other streams are tried on is about packets of which a revolution has many.
KINDS: tuple[str, ...] = ()
OF_GOLDEN_ALONE = tuple(case.name for case in CASES)
LAYOUTS = (_case("hokuyo ME", StrengthFormat),)
"""The other format, which has no golden stream."""
