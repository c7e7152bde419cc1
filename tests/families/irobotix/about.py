"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidario.families.irobotix.decode import FrameDecoder
from lidario.families.irobotix.formats import FifteenFormat, FrameFormat
from lidario.families.irobotix.simulated import make_simulated, pack_measurement
from tests.reference import golden, irobotix
from tests.support.case import Case, Maker, of_a_talker

MAKER = Maker(make_simulated, "irobotix-delta2a", 1 / 6, obeys=False)
MODELS = ("irobotix-delta2a", "irobotix-delta2g")


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    frames = 15 if case.response_type == FifteenFormat.response_type else 16
    made = []
    for start in starts.tolist():
        count = int(random.integers(1, 81) if wild else random.integers(20, 24))
        distances, signals = random.integers(0, 65_536, count) / 4, random.integers(0, 256, count)
        at = start % 65_536 if wild else start % 23_040 * frames // 23_040 * 36_000 // frames
        hertz = float(random.integers(4, 10))
        made.append(pack_measurement(at, distances.tolist(), signals.tolist(), hertz=hertz))
    return made


def _sealed(case: Case, contents: bytes) -> bytes:
    body = case.packets[0][:8] + contents[8:-2]
    return body + irobotix.total(body)


def _case(name: str) -> Case:
    fifteen = "2g" in name
    wire = FifteenFormat if fifteen else FrameFormat
    decoder = partial(FrameDecoder, wire)
    decode = partial(irobotix.decode, frames=15 if fifteen else 16)
    return of_a_talker(
        name, wire, decoder, split=irobotix.split, decode=decode, contents=_contents, seal=_sealed, even=False
    )


CASES = tuple(map(_case, golden.names_of("irobotix")))
KINDS = ("irobotix_2a_6hz", "irobotix_2g_5hz")
OF_GOLDEN_ALONE = ()
