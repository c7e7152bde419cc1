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


NONE = {
    **{f"{count} samples": pack_measurement(0, [100.0] * count, [9] * count) for count in (0, 81, 300)},
    "a part of a sample": pack_frame(0xAD, PACKETS[0][8:-4]),
    "no speed": pack_frame(0xAE, b""),
    "more than a speed": pack_frame(0xAE, b"\x69\x00"),
}
"""What is no frame, check value and all: it has up to 80 whole samples, or one byte that tells of the rotor."""


@pytest.mark.parametrize("what", NONE)
def test_no_others(what: str) -> None:
    other = NONE[what]
    assert counted(b"".join([PACKETS[0], other, *PACKETS[1:4]])) == (4, 0, len(other))
    assert "samples" not in what or FrameFormat().measure(bytearray(other), 0) == NO_PACKET


def test_a_frame_of_any_kind_has_its_size() -> None:
    assert pack_failure(5.25)[4:] != FAILURE[4:]  # another version, and so another sum
    assert AnyFrame().run(bytearray(FAILURE), 0).end == AnyFrame.shortest == len(FAILURE)
    assert AnyFrame().run(bytearray(PACKETS[0]), 0).end == len(PACKETS[0])
