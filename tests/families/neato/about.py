"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidario.families.neato.formats import BackFormat, PacketFormat
from lidario.families.neato.simulated import make_simulated, pack_packet
from lidario.families.slots import DegreeDecoder
from tests.reference import golden, neato
from tests.reference.samples import fold
from tests.support.case import Case, Maker, of_a_talker

MAKER = Maker(make_simulated, "neato-xv11", 0.2, obeys=False)
MODELS = ("neato-xv11", "neato-lds02rr")


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    return [
        pack_packet(
            start % 23_040 // 256,
            random.integers(0, 0x8000 if wild else 0x4000, 4).tolist(),
            random.integers(0, 2048, 4).tolist(),
            rpm=int(random.integers(200, 1024)),
        )
        for start in starts.tolist()
    ]


def _sealed(case: Case, contents: bytes) -> bytes:
    packet = case.packets[0]
    # A speed at which it measures.
    body = packet[:4] + contents[4:-2]
    return body + fold(body).to_bytes(2, "little")


def _case(name: str, *, back: bool) -> Case:
    wire = BackFormat if back else PacketFormat
    decode = partial(neato.decode, back=back)
    return of_a_talker(
        name,
        wire,
        partial(DegreeDecoder, wire),
        split=neato.split,
        decode=decode,
        contents=_contents,
        seal=_sealed,
        even=False,
        intensity_bits=11,
    )


CASES = tuple(_case(name, back=True) for name in golden.names_of("neato"))
LAYOUTS = (_case("neato_xv11_5hz", back=False),)
"""The packets of an LDS02RR are the same, read in the other sense."""
KINDS = ("neato_xv11_5hz",)
OF_GOLDEN_ALONE = ()
