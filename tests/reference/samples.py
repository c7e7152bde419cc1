"""What the scalar references of all families call a sample, where a turn of them ends, and what several share."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sample:
    """One measurement."""

    packet: int  # index into the packets given to decode()
    index: int  # place inside that packet
    raw_deg: float  # where the beam is: before corrections of the single sample, may pass 360 inside a packet
    angle_deg: float  # where the target is: corrected, 0 <= angle_deg < 360
    distance_mm: float  # 0 = no return
    quality: int | None  # None if the format carries none


def revolutions(samples: Iterable[Sample]) -> list[list[Sample]]:
    """Whole turns only: the samples before the first passage of 0° and those after the last one are left out.

    A turn begins with the first sample at or past 0°: where the beam angle falls by more than half a turn.
    """
    turns: list[list[Sample]] = []
    current: list[Sample] | None = None  # None until the first passage
    previous: Sample | None = None
    for sample in samples:
        if previous is not None and previous.raw_deg % 360 - sample.raw_deg % 360 > 180:
            if current is not None:
                turns.append(current)
            current = []
        if current is not None:
            current.append(sample)
        previous = sample
    return turns


def u16(data: bytes, offset: int) -> int:
    """Two bytes, the low one first."""
    return int.from_bytes(data[offset : offset + 2], "little")


def fold(body: bytes) -> int:
    """The check value of fifteen bits behind so many words, as the program in the XV-11's wiki has it."""
    check = 0
    for at in range(0, len(body), 2):
        check = (check << 1) + u16(body, at)
    return ((check & 0x7FFF) + (check >> 15)) & 0x7FFF


def cut(raw: bytes, size: int, is_packet: Callable[[bytes], bool]) -> list[bytes]:
    """Cut a clean stream into packets of one size; ValueError where it is not clean."""
    packets = [raw[at : at + size] for at in range(0, len(raw), size)]
    if not all(map(is_packet, packets)):
        raise ValueError("this is no clean stream")
    return packets


def whole(data: bytes, size: int, is_packet: Callable[[bytes], bool]) -> list[bytes]:
    """The packets in what was heard from anywhere on."""
    at = next(at for at in range(len(data)) if is_packet(data[at : at + size]))
    return cut(data[at : at + (len(data) - at) // size * size], size, is_packet)
