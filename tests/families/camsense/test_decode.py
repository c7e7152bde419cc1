"""The rate of a stream, and packets of an LDS08RR."""

import numpy as np
import pytest

import lidario
from lidario.families.camsense.decode import PacketDecoder
from lidario.families.camsense.formats import LongFormat, PacketFormat
from lidario.families.camsense.simulated import pack_packet
from tests.families.camsense.about import CASES
from tests.support.streams import in_one_run


def test_the_rate_is_told_to_half_a_percent() -> None:
    for at in range(0, 900, 24):
        packets = b"".join(CASES[0].packets[at : at + 24])
        assert PacketFormat.samples_a_second(packets) == pytest.approx(2080, rel=0.006)
        assert PacketFormat.sample_us(packets) == pytest.approx(1e6 / PacketFormat.samples_a_second(packets))


def test_packets_of_twelve_samples() -> None:
    step, raw, at = 40, b"", 0
    for _ in range(100):
        begin, end = at % 23_040, (at + 11 * step) % 23_040
        raw += pack_packet(0xA000 + begin, 0xA000 + end, [1500.0] * 11 + [0.0], [300] * 12)
        at += 12 * step
    samples = PacketDecoder(LongFormat).decode(in_one_run(LongFormat(), raw), None)
    assert samples.intensity is not None
    assert samples.intensity.reshape(-1, 12)[5].tolist() == [255] * 11 + [0]
    np.testing.assert_allclose(samples.distance_mm.reshape(-1, 12)[:, :11], np.hypot(1500, 20))
    scans = list(lidario.decode(raw))
    assert len(scans) == 1
    assert (len(scans[0]), scans[0].lost_packets) == (576, 0)
