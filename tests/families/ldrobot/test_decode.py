"""The one of 256 damaged packets that the CRC does not find."""

from dataclasses import replace

import numpy as np
import pytest

import lidario
from lidario.families.ldrobot import TALKERS
from lidario.families.ldrobot.formats import CRC, SIZE, PacketFormat
from lidario.families.ldrobot.simulated import PROFILES, SimulatedLdrobot
from lidario.families.registry import family_of_simulated
from lidario.families.samples import Samples
from lidario.families.talking import TalkingDevice
from lidario.families.two_angles import TwoAngleDecoder
from lidario.wire.blocks import Block
from lidario.wire.events import Packets

COUNT = 20


def packets_of(model: str = "ldrobot-ld19") -> list[bytes]:
    """Some packets of a clean stream, none of which lies across 0."""
    device = family_of_simulated(model).simulate(model, spin_up=0.0, seed=3)
    now, raw = 0, b""
    for _ in range(40):
        now += 10_000_000
        raw += device.transmit(now)
    begin = raw.index(b"\x54\x2c")
    found = [raw[at : at + SIZE] for at in range(begin, len(raw) - SIZE, SIZE)]
    starts = [int.from_bytes(each[4:6], "little") for each in found]
    first = next(at for at, start in enumerate(starts) if start < 1000)
    return found[first + 2 : first + 3 + COUNT]


def decoded(packets: list[bytes]) -> Samples:
    """All but the last, which is the one that follows."""
    data = b"".join(packets[:-1])
    blocks = (Block(SIZE, len(packets) - 1),)
    return TwoAngleDecoder(PacketFormat).decode(Packets(data, blocks, ()), packets[-1])


def with_end(packet: bytes, end: int) -> bytes:
    """The packet with another last angle, and a check value that holds."""
    body = packet[:42] + end.to_bytes(2, "little") + packet[44:46]
    return body + bytes((CRC.of(body),))


@pytest.mark.parametrize("turned", [1265, 13_627, 30_000, -500])
def test_a_wrong_last_angle_loses_no_packets(turned: int) -> None:
    packets = packets_of()
    clean = decoded(packets)
    end = (int.from_bytes(packets[8][42:44], "little") + turned) % 36_000
    found = decoded([*packets[:8], with_end(packets[8], end), *packets[9:]])
    assert (found.lost, found.lost_behind, found.unbroken) == (0, 0, COUNT)
    # The points of that packet alone stand elsewhere.
    moved = np.flatnonzero(np.abs(found.angle_deg - clean.angle_deg) > 0.02)
    assert 8 * 12 <= moved.min() <= moved.max() < 9 * 12
    assert found.last.samples == pytest.approx(clean.last.samples, rel=0.001)


def test_of_packets_that_are_missing_beside_a_wrong_angle_none_is_told_twice() -> None:
    packets = packets_of()
    end = (int.from_bytes(packets[4][42:44], "little") + 9000) % 36_000
    found = decoded([*packets[:4], with_end(packets[4], end), *packets[5:8], *packets[10:]])
    assert (found.lost, found.unbroken) == (2, 8)


@pytest.mark.parametrize("wrap_ms", [30_000, 65_536])
def test_the_clock_of_an_ld08_may_begin_anew_at_either_number(wrap_ms: int) -> None:
    """No document tells at which (more_families_2.md 1.8)."""
    device = SimulatedLdrobot(replace(PROFILES["ldrobot-ld08"], wrap_ms=wrap_ms))
    begin = (wrap_ms - 2000) * 1_000_000
    device.transmit(begin)
    raw = device.transmit(begin + 4_000_000_000)
    raw = raw[raw.index(b"\x54\x2c") :]
    times = [int.from_bytes(raw[at + 44 : at + 46], "little") for at in range(0, len(raw) - SIZE, SIZE)]
    assert min(times) < 100
    assert max(times) > wrap_ms - 100
    scans = list(lidario.decode(raw, model="ld08"))
    assert [scan.seq for scan in scans] == list(range(len(scans)))
    assert np.diff([scan.stamp_ns for scan in scans]) == pytest.approx(200_000_000, rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize("lost", [0.1, 0.2, 0.5])
@pytest.mark.parametrize("model", ["ldrobot-ld06", "ldrobot-ld19"])
def test_a_device_of_which_packets_are_lost_is_no_other_model(model: str, lost: float) -> None:
    random = np.random.default_rng(5)
    for _ in range(8):
        packets = [packet for packet in [*packets_of(model), *packets_of(model)] if random.random() >= lost]
        script = TalkingDevice(TALKERS).identify()
        next(script)
        script.send(b"".join(packets[:2]))
        with pytest.raises(StopIteration) as ended:
            script.send(b"".join(packets[: TALKERS.heard]))
        assert ended.value.value.model == "LDROBOT LD06, LD19 or alike"
