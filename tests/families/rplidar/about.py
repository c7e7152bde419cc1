"""What tests of all families must know of this one: a simulated device, its streams, and its models."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidario.families.rplidar import commands as rplidar_commands
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.simulated import packers
from lidario.families.rplidar.simulated.device import make_simulated
from tests.reference import golden, rplidar
from tests.support.case import Case, Maker

MAKER = Maker(make_simulated, "rplidar-s2", 0.1, obeys=True)
MODELS = ("rplidar-s2", "rplidar-a1", "rplidar-hq", "rplidar-ultra", "rplidar-no-modes", "rplidar-old-firmware")


def _case(name: str) -> Case:
    stream = golden.load(name)
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
        lookahead=answer in rplidar.CAPSULE_TYPES,
        contents=_contents,
        seal=_sealed,
    )


def _contents(case: Case, random: np.random.Generator, starts: NDArray[np.int64], wild: bool) -> list[bytes]:
    count = len(starts)
    if case.response_type == 0x81:
        quality = random.integers(0, 64, count)
        raw = packers.pack_standard(
            starts % 23040, random.integers(0, 65536, count), quality, np.zeros(count, bool)
        )
        return [raw[at : at + 5] for at in range(0, len(raw), 5)]
    if case.response_type == 0x83:
        angles = random.integers(0, 65536, (count, 96)) if wild else (starts[:, None] + np.arange(96)) % 65536
        flags = random.integers(0, 256, (count, 96))
        # Beyond 24 bits, single precision has no quarters of millimetres any more.
        distances = random.integers(0, 2 ** (32 if wild else 24), (count, 96))
        raw = packers.pack_hq(angles, distances, flags, flags)
        return [raw[at : at + 781] for at in range(0, len(raw), 781)]
    return [
        _capsule(case, random.bytes(len(case.packets[0]) - 2), start | int(wild and random.random() < 0.1) << 15)
        for start in starts.tolist()
    ]


def _capsule(case: Case, contents: bytes, start: int) -> bytes:
    body = bytearray(contents)
    at = 6 if case.response_type == 0x86 else 0
    body[at : at + 2] = start.to_bytes(2, "little")
    return _checked(bytes(body))


def _sealed(case: Case, contents: bytes) -> bytes:
    if case.response_type != 0x81:
        return _checked(contents[2:])
    begins = contents[0] & 1
    # Beyond 360 degrees it would be no node.
    angle = int.from_bytes(contents[1:3], "little") % (2 * 23040) | 1
    return bytes([contents[0] & 0xFC | begins | (1 - begins) << 1]) + angle.to_bytes(2, "little") + contents[3:]


def _checked(body: bytes) -> bytes:
    check = 0
    for byte in body:
        check ^= byte
    return bytes([0xA0 | check & 0xF, 0x50 | check >> 4]) + body


CASES = tuple(map(_case, golden.names_of("rplidar")))
KINDS = tuple(f"rplidar_32k_{answer:x}" for answer in range(0x81, 0x87))
OF_GOLDEN_ALONE = ()
