"""The packers of the simulator: golden streams are packed to the same bytes, and what does not fit is refused."""

import struct

import numpy as np
import pytest

from lidario.families.rplidar.simulated import packers
from tests.reference import golden, rplidar


@pytest.mark.parametrize("rate", ["32k", "9k"])
@pytest.mark.parametrize("kind", range(0x81, 0x87))
def test_golden_streams_are_packed_to_the_same_bytes(rate: str, kind: int) -> None:
    stream = golden.load(f"rplidar_{rate}_{kind:x}")
    packets = rplidar.split(kind, stream.raw)
    if kind in rplidar.CAPSULE_TYPES:
        starts = [rplidar.start_q6(kind, packet) for packet in packets]
        new = rplidar.is_reset(kind, packets[0])
        count = rplidar.PACKET_SAMPLES[kind]
        # The decoder needs a successor: the last packet is not compared.
        distances = np.array([s.distance_mm for s in rplidar.decode(kind, packets)]).reshape(-1, count)
        expected = b"".join(packets[:-1])
    if kind == 0x81:
        samples = rplidar.decode(kind, packets)
        got = packers.pack_standard(
            [round(s.raw_deg * 64) for s in samples],
            [round(s.distance_mm * 4) for s in samples],
            [(s.quality or 0) >> 2 for s in samples],
            [packet[0] & 1 for packet in packets],
        )
        expected = stream.raw
    elif kind == 0x82:
        offsets = [
            (p[4 + 5 * c + 4] >> 4 * h & 15) | (p[4 + 5 * c + 2 * h] & 3) << 4
            for p in packets[:-1] for c in range(16) for h in (0, 1)
        ]  # fmt: skip
        got = packers.pack_express(starts[:-1], distances, offsets, new_stream=new)
    elif kind == 0x83:
        nodes = np.array([struct.unpack("<BQ" + "HIBB" * 96 + "I", p)[2:-1] for p in packets])
        times = [struct.unpack_from("<Q", p, 1)[0] for p in packets]
        got = packers.pack_hq(*(nodes[:, k::4] for k in range(4)), time_us=times)
        expected = stream.raw
    elif kind == 0x84:
        following = struct.unpack_from("<I", packets[-1], 4)[0] & 0xFFF
        got = packers.pack_ultra(starts[:-1], distances, _vbs_mm(following), new_stream=new)
    elif kind == 0x85:
        got = packers.pack_dense(starts[:-1], distances, new_stream=new)
    else:
        words = np.array(
            [
                (struct.unpack_from("<H", p, 10 + 5 * c + 2 * h)[0] | (p[14 + 5 * c] >> 4 * h & 15) << 16)
                for p in packets[:-1] for c in range(32) for h in (0, 1)
            ]
        ).reshape(-1, 64)  # fmt: skip
        scale = words & 3
        steps = words >> 2 & (1 << 10 + scale) - 1
        mm = np.choose(scale, [steps * 2, steps * 3 + 2046, steps * 4 + 8187, steps * 5 + 24567])
        mm = mm + 0.4 * (steps == 0) * (scale > 0)  # 2046 mm can be said in scale 0 and 1: mean the latter
        got = packers.pack_ultra_dense(
            starts[:-1],
            mm,
            words >> 12 + scale << scale,
            time_us=[struct.unpack_from("<I", p, 2)[0] for p in packets[:-1]],
            status=struct.unpack_from("<H", packets[0], 6)[0],
            new_stream=new,
        )
    if kind == 0x84:
        got, expected = _one_mark_for_nothing(got), _one_mark_for_nothing(expected)
    # Not compared as bytes: pytest would work for hours on the difference.
    assert len(got) == len(expected)
    assert np.flatnonzero(np.frombuffer(got, np.uint8) != np.frombuffer(expected, np.uint8)).tolist() == []


def _one_mark_for_nothing(raw: bytes) -> bytes:
    """The bodies of 0x84 packets with 511, which means "no return" as well as -512 does, replaced by that."""
    words = np.frombuffer(raw, "<u4").reshape(-1, 33)[:, 1:].copy()
    for shift in (12, 22):
        words[words >> shift & 0x3FF == 511] ^= (511 ^ 512) << shift
    return words.tobytes()


def _vbs_mm(code: int) -> int:
    return next(
        base + (code - first << shift)
        for first, base, shift in (
            (3328, 16384, 4), (1792, 4096, 3), (1280, 2048, 2), (512, 512, 1), (0, 0, 0),
        )
        if code >= first
    )  # fmt: skip


def test_what_does_not_fit_is_refused_not_wrapped() -> None:
    with pytest.raises(ValueError, match="distance"):
        packers.pack_dense(0, np.full(40, 65536))
    with pytest.raises(ValueError, match="distance"):
        packers.pack_express(0, np.full(32, 16384))
    with pytest.raises(ValueError, match="start angle"):
        packers.pack_dense(0x8000, np.zeros(40))
    with pytest.raises(ValueError, match="quality"):
        packers.pack_standard(0, 0, 64, False)
    with pytest.raises(ValueError, match="reshape"):
        packers.pack_dense(0, np.zeros(39))
