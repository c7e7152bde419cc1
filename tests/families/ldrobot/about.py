"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lidario.families.ldrobot import AXIS, BEAM, TRIANGLE
from lidario.families.ldrobot.simulated import make_simulated, pack_points
from tests.reference import golden, ldrobot
from tests.support.case import Case, Maker, of_a_talker

MAKER = Maker(make_simulated, "ldrobot-ld06", 0.1, obeys=False)
MODELS = ("ldrobot-ld19", "ldrobot-ld14p")


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    count = len(starts)
    raw = pack_points(
        random.integers(0, 65536, (count, 12)),
        random.integers(0, 256, (count, 12)),
        starts % 36_000,
        (starts + random.integers(0, 3000, count)) % 36_000,
        speed=random.integers(0, 65536, count),
    )
    return [raw[at : at + 47] for at in range(0, len(raw), 47)]


def _sealed(case: Case, contents: bytes) -> bytes:
    packet = case.packets[0]
    # Angles that one packet can have.
    body = packet[:6] + contents[6:-5] + packet[-5:-1]
    return body + bytes((ldrobot.crc8(body),))


def _case(name: str) -> Case:
    lens: Literal["", "ld08", "ld14"] = "ld14" if "ld14" in name else "ld08" if "ld08" in name else ""
    kind = {"": BEAM, "ld14": TRIANGLE, "ld08": AXIS}[lens]
    decode = partial(ldrobot.decode, lens=lens)
    return of_a_talker(
        name, kind.wire, kind.decoder, split=ldrobot.split, decode=decode, contents=_contents, seal=_sealed
    )


CASES = tuple(map(_case, golden.names_of("ldrobot")))
KINDS = ("ldrobot_ld19_6hz", "ldrobot_ld14p_6hz", "ldrobot_ld08_5hz")
OF_GOLDEN_ALONE = ("ldrobot_ld19_13hz", "ldrobot_stl27l_6hz")
