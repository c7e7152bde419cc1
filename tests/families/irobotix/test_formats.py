"""How long a frame is, and what are records between them."""

import pytest

from lidario.families.irobotix.formats import AnyFrame, FrameFormat
from lidario.families.irobotix.simulated import pack_failure, pack_frame, pack_measurement
from lidario.wire.formats import NO_PACKET
from tests.families.irobotix.about import CASES
from tests.support.streams import feed, in_one_run

PACKETS = CASES[0].packets
FAILURE = bytes.fromhex("AA00090061AE000169022C")
"""5.25 revolutions a second, as the protocol document has it; its version is 00."""


def counted(raw: bytes) -> tuple[int, int, int]:
    """Packets, records and skipped bytes."""
    stats = feed(CASES[0], raw).stats
    return stats.packets, stats.records, stats.skipped_bytes


def test_any_number_of_samples_is_a_frame() -> None:
    frames = [pack_measurement(0, [100.0] * count, [9] * count) for count in range(1, 81)]
    frames += [pack_measurement(0, [100.0] * count, [9] * count, end=7, version=0x10) for count in range(1, 81)]
    assert counted(b"".join(frames)) == (160, 0, 0)
    assert [FrameFormat().measure(bytearray(each), 0) for each in frames] == list(map(len, frames))
    assert (FrameFormat.shortest, FrameFormat.longest) == (min(map(len, frames)), max(map(len, frames)))


@pytest.mark.parametrize("count", [1, 30, 80])
@pytest.mark.parametrize("end", [None, 7])
def test_a_frame_tells_how_many_samples_it_has_and_what_they_take(count: int, end: int | None) -> None:
    frame = pack_measurement(
        0, [100.0] * count, [9] * count, hertz=5.0, end=end, version=1 if end is None else 0x10
    )
    run = in_one_run(FrameFormat(), frame * 3)
    assert FrameFormat().samples_in(run.blocks) == 3 * count
    assert FrameFormat().told_sample_ns(run).tolist() == pytest.approx([1e9 / (5 * 16 * count)] * 3)


@pytest.mark.parametrize("at", [0, 1, 4, 5])
def test_what_begins_no_frame_is_not_waited_for(at: int) -> None:
    head = bytearray(PACKETS[0][: at + 1])
    assert FrameFormat().measure(head, 0) == 0
    head[at] ^= 0x01
    assert FrameFormat().measure(head, 0) == NO_PACKET


@pytest.mark.parametrize("count", [0, 81, 300])
def test_no_others(count: int) -> None:
    other = pack_measurement(0, [100.0] * count, [9] * count)
    assert FrameFormat().measure(bytearray(other), 0) == NO_PACKET
    assert counted(b"".join([PACKETS[0], other, *PACKETS[1:4]])) == (4, 0, len(other))


def test_the_data_of_a_frame_are_whole_samples() -> None:
    cut = pack_frame(0xAD, PACKETS[0][8:-4])
    assert counted(b"".join([PACKETS[0], cut, *PACKETS[1:4]])) == (4, 0, len(cut))


@pytest.mark.parametrize("data", [b"", b"\x69\x00"])
def test_one_that_tells_of_the_rotor_has_one_byte_of_data(data: bytes) -> None:
    other = pack_frame(0xAE, data)
    assert counted(b"".join([PACKETS[0], other, *PACKETS[1:4]])) == (4, 0, len(other))


def test_other_frames_are_records() -> None:
    assert pack_failure(5.25)[4:] != FAILURE[4:]  # another version, and so another sum
    raw = b"".join([FAILURE, pack_failure(1.0), *PACKETS[:5], pack_frame(0xAB, b"\x01\x02"), *PACKETS[5:9]])
    assert counted(raw) == (9, 3, 0)
    assert AnyFrame().run(bytearray(FAILURE), 0).end == AnyFrame.shortest == len(FAILURE)
    assert AnyFrame().run(bytearray(PACKETS[0]), 0).end == len(PACKETS[0])
