"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

import dataclasses
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidario.families.camsense.decode import PacketDecoder
from lidario.families.camsense.formats import LongFormat, PacketFormat
from lidario.families.camsense.simulated import make_simulated, pack_packet
from tests.reference import camsense, golden
from tests.reference.samples import fold
from tests.support.case import Case, Maker, of_a_talker

MAKER = Maker(make_simulated, "camsense-x1", 0.1923, obeys=False)
MODELS = ("camsense-x1", "camsense-lds08rr")


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    made = []
    for start in starts.tolist():
        begin = start % 23_040
        end = (begin + int(random.integers(1, 1000))) % 23_040
        distances = random.integers(0, 0x4000, 8).tolist()
        made.append(pack_packet(0xA000 + begin, 0xA000 + end, distances, random.integers(0, 256, 8).tolist()))
    return made


def _sealed(case: Case, contents: bytes) -> bytes:
    packet = case.packets[0]
    # Angles at which it turns.
    body = packet[:8] + contents[8:-4] + packet[-4:-2]
    return body + fold(body).to_bytes(2, "little")


def _case(name: str) -> Case:
    return of_a_talker(
        name,
        PacketFormat,
        partial(PacketDecoder, PacketFormat),
        split=camsense.split,
        decode=camsense.decode,
        contents=_contents,
        seal=_sealed,
    )


CASES = tuple(map(_case, golden.names_of("camsense")))
LAYOUTS = tuple(
    dataclasses.replace(
        case,
        response_type=LongFormat.response_type,
        make_format=LongFormat,
        make_decoder=partial(PacketDecoder, LongFormat),
    )
    for case in CASES
)
"""The packets of an LDS08RR differ in their length alone; tests/families/camsense/test_decode.py has some."""
KINDS = ("camsense_x1_5hz",)
OF_GOLDEN_ALONE = ()
