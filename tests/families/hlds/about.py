"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidario.families.hlds.formats import CheckedFormat, PacketFormat
from lidario.families.hlds.simulated import make_simulated, pack_packet
from lidario.families.slots import DegreeDecoder
from tests.reference import hlds
from tests.support.case import Case, Maker, of_a_talker

MAKER = Maker(make_simulated, "hlds-lds01", 0.2, obeys=False)
MODELS = ("hlds-lds01",)


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    return [
        pack_packet(
            start % 23_040 // 384,
            random.integers(0, 0x10000 if wild else 3500, 6).tolist(),
            random.integers(0, 8192, 6).tolist(),
            rpm=int(random.integers(100, 600)),
        )
        for start in starts.tolist()
    ]


def _sealed(case: Case, contents: bytes) -> bytes:
    body = case.packets[0][:4] + contents[4:-2]
    return body + hlds.twice(body)


def _case(wire: type[CheckedFormat]) -> Case:
    return of_a_talker(
        "hlds_lds01_5hz",
        wire,
        partial(DegreeDecoder, wire),
        split=hlds.split,
        decode=hlds.decode,
        contents=_contents,
        seal=_sealed,
        even=False,
        intensity_bits=13,
    )


CASES = (_case(CheckedFormat),)
LAYOUTS = (_case(PacketFormat),)
"""The same packets, believed when the next one follows."""
KINDS = ("hlds_lds01_5hz",)
OF_GOLDEN_ALONE = ()
