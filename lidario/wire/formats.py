"""How a measurement stream is parsed into packets: the interface of a format, and what all formats share.

No format has framing beyond its own first bytes and a check value. So a packet is believed if three things agree:
it begins with the right bytes (`StreamFormat.header`), its length is known (`measure`), and its check value holds
(`intact`). `next_stretch` uses these three, in the same way for every format:

* while in step, whole runs of packets are taken;
* a packet that fails its check is searched *inside*, because the next packet may begin in its middle if bytes were
  lost or added;
* a packet found that way needs a second proof, because an 8-bit check value lets one false packet in 256 pass. The
  proof is the beginning of another packet behind it, or an intact packet a few whole lengths before it (`REACH`).
  It is false if it overlaps an intact packet that is in line with the last real one.

Every decision waits until the bytes that it needs are there, so results do not depend on how the stream was
divided. A format object belongs to one stream: it remembers whether it is in step.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidario.wire.blocks import Block
from lidario.wire.events import Packets

NO_PACKET = -1
"""Result of `measure` and `other_record`: no packet or record begins here."""

BEGINS = 1 << 28
"""Flag in a heading: the device marks this packet as the first of a revolution."""

RESTARTS = 1 << 29
"""Flag in a heading: the device says that the stream began anew with this packet. The angles show if it did."""

HEADING_MASK = BEGINS - 1
"""Mask of the angle in a heading, without the flags."""

REACH = 8
"""An intact packet is the proof of another in line with it, up to this many packet lengths away. Random bytes look
like such a pair thirty times less often than like a packet with the beginning of another one behind it. If half of
the packets come, nearly all of these are found."""

HEADINGS_WORTH_AN_ARRAY = 24
"""From this many packets on, headings are made and compared as an array. Measured: making and comparing a list
takes 0.4 us a packet, an array 8 to 10 us for any number up to 100. Live, a poll brings fewer packets, a file
hundreds."""

Headings: TypeAlias = Sequence[int] | NDArray[np.integer[Any]]
"""Start angles of consecutive packets, with the two flags: a list if they are few, else an array."""


def headings_of(angles: NDArray[np.integer[Any]]) -> Headings:
    """The headings of packets, by their start angles."""
    return angles if len(angles) >= HEADINGS_WORTH_AN_ARRAY else angles.tolist()


class Ticks(NamedTuple):
    """How the clock of a device counts, if packets carry its stamps."""

    tick_ns: int  # nanoseconds from one number to the next
    wrap: int  # the number at which the clock begins again with 0


class Stretch(NamedTuple):
    """The next part of a stream: packets, and the noise or record behind them."""

    # Sizes of the intact packets that begin at the given place; empty if there are none.
    packets: tuple[Block, ...]
    middle: int  # where the packets end
    end: int  # where the noise, or the record that is no measurement, behind them ends; `middle` if there is none


class StreamFormat(ABC):
    """One measurement format, following one stream."""

    name: str  # the documents' name of the format
    response_type: int  # the type byte of the descriptor that announces it
    # Pattern of the first byte of a packet, or of the first two. A longer pattern would miss a packet of which only
    # the beginning has come. `measure` checks the rest.
    header: re.Pattern[bytes]
    shortest: int  # bytes of the shortest packet; with fewer bytes, nothing can be decided
    longest: int  # bytes of the longest packet
    samples: int  # samples in one packet, if all packets have as many; else 1
    full_turn: int  # 360 degrees in the unit of `headings`
    first_seam: int | None = 0  # heading at which revolutions begin; None if only marked packets (`BEGINS`) tell
    self_evident: bool = False  # True if the check value is strong enough to need no second proof
    ticks: Ticks | None = None  # how the clock behind the `stamps` counts; None if packets carry no stamps
    # Whether each packet tells the angles of all its samples. If not, only the packets behind it show how far the
    # rotor turned during it.
    own_angles: bool = True
    # Whether each packet is a whole scan: all that the device sees in one revolution, which may be less than 360
    # degrees.
    whole: bool = False
    begin_deg: float = 0.0  # where such a scan begins, degrees clockwise
    # How far it reaches from there, degrees; negative if the rotor turns counter-clockwise.
    field_deg: float = 360.0

    def __init__(self) -> None:
        self._in_step = True
        # Used while out of step; both count from the place given to `next_stretch`. First: where the last real
        # packet ends, or a damaged one in line with it. Second: where the last intact packet without proof ends.
        self._last_end = self._other_end = 0

    @classmethod
    def sample_us(cls, packets: bytes) -> float:  # noqa: ARG003
        """Microseconds of a sample, by packets in a row; 0 if they do not tell."""
        return 0.0

    def stamps(self, packets: Packets) -> NDArray[np.int64]:  # noqa: ARG002
        """The stamp of each packet by the device's clock; empty if packets carry none (`ticks`)."""
        return np.empty(0, np.int64)

    def told_sample_ns(self, packets: Packets) -> NDArray[np.float64] | None:  # noqa: ARG002
        """Nanoseconds of a sample in each packet, if packets tell a speed that decides it; else None."""
        return None

    @property
    def pitch(self) -> int:
        """Samples from the beginning of a packet to that of the next, with those that the device does not take."""
        return self.samples

    @property
    def ordinary(self) -> int:
        """Bytes of the longest packet that devices are known to send; `longest` is the longest that is accepted."""
        return self.longest

    @abstractmethod
    def measure(self, data: bytearray, at: int) -> int:
        """Length of the packet that begins at `at`; 0 to wait for more bytes, `NO_PACKET` if none begins there."""

    @abstractmethod
    def intact(self, data: bytearray, at: int, size: int) -> bool:
        """Whether the check value of the packet at `at` holds; all its `size` bytes must be there."""

    @abstractmethod
    def headings(self, packets: Packets) -> Headings:
        """Start angle of each packet, in [0, full_turn), with `BEGINS` and `RESTARTS` where they apply."""

    def samples_in(self, blocks: Iterable[Block]) -> int:
        """Samples in packets of these sizes. Default: every packet has `samples`."""
        return self.samples * sum([packets for _, packets in blocks])

    def mend(self, data: bytearray, at: int) -> bool:  # noqa: ARG002
        """Repair in `data` the damaged packet that is due at `at`, if its check value shows how. Default: never."""
        return False

    def other_record(self, data: bytearray, at: int) -> int:  # noqa: ARG002
        """Length of a known record at `at`, as `measure`: it may stand between packets and is no measurement."""
        return NO_PACKET

    def run(self, data: bytearray, at: int) -> Stretch:
        """The intact packets that follow each other from `at`, and nothing behind them."""
        found: list[Block] = []
        size = count = 0
        while len(data) - at >= self.shortest:
            of_next = self.measure(data, at)
            if not 0 < of_next <= len(data) - at or not self.intact(data, at, of_next):
                break
            if of_next != size and count:
                found.append(Block(size, count))
                count = 0
            size, count, at = of_next, count + 1, at + of_next
        if count:
            found.append(Block(size, count))
        return Stretch(tuple(found), at, at)

    def packets_in(self, data: bytearray) -> tuple[int, bytes]:
        """How many packets there are in `data`, as far as these bytes show, and the bytes of these packets."""
        at = count = 0
        found = bytearray()
        while (stretch := self.next_stretch(data, at)).end > at:
            count += sum([packets for _, packets in stretch.packets])
            found += data[at : stretch.middle]
            at = stretch.end
        return count, bytes(found)

    def next_stretch(self, data: bytearray, at: int) -> Stretch:
        """The next packets, or the noise or record, at `at`; `end` equal to `at` means: wait for more bytes."""
        if at == len(data):
            return Stretch((), at, at)
        if self._in_step:
            run = self.run(data, at)
            if run.packets:
                return run
            record = self._whole_record(data, at)
            if record:
                return Stretch((), at, at + record)
            size = self.measure(data, at)
            if not size or size > len(data) - at or (size == NO_PACKET and self.other_record(data, at) == 0):
                return Stretch((), at, at)
            self._in_step, self._last_end, self._other_end = False, 0, 0
        noise = self._end_of_noise(data, at)
        self._last_end -= noise - at
        self._other_end -= noise - at
        if noise == at and self._in_step:
            # The awaited packet begins right here, and it is whole.
            run = self.run(data, at)
            return run if run.packets else Stretch((), at, at + self._whole_record(data, at))
        return Stretch((), at, noise)

    def _whole_record(self, data: bytearray, at: int) -> int:
        size = self.other_record(data, at)
        return size if 0 < size <= len(data) - at else 0

    def _end_of_noise(self, data: bytearray, at: int) -> int:
        """Where the noise that begins at `at` ends, as far as the bytes so far show it."""
        place = at
        while True:
            found = self.header.search(data, place)
            if found is None:
                # The last byte may be the first of a header.
                return max(place, len(data) - 1)
            place = found.start()
            size = self.measure(data, place)
            if size == 0 or size > len(data) - place:
                return place
            if size == NO_PACKET and self.self_evident:
                record = self.other_record(data, place)
                if record != NO_PACKET:
                    self._in_step = 0 < record <= len(data) - place
                    return place
            if size != NO_PACKET and self.intact(data, place, size):
                proof = self._proof(data, at, place, size)
                if proof is None:
                    return place
                if proof:
                    self._in_step = True
                    return place
            elif size != NO_PACKET and self._due_in(place - at, self._last_end) == 0:
                if self.mend(data, place):
                    self._in_step = True
                    return place
                self._last_end = place + size - at
            place += 1

    def _due_in(self, way: int, end: int) -> int | None:
        """Bytes from the place `way` to where a packet is due, by one that ends at `end`; None if that is far."""
        return (end - way) % self.longest if way - end < REACH * self.longest else None

    def _proof(self, data: bytearray, at: int, place: int, size: int) -> bool | None:
        """Whether the intact packet at `place` is a real one; None while bytes to decide it are missing."""
        due_in = self._due_in(place - at, self._last_end)
        if self.self_evident or due_in == 0 or self._due_in(place - at, self._other_end) == 0:
            return True
        behind = place + size
        if behind >= len(data):
            return None
        if due_in is not None:
            # Start angles may look like headers, and come again in each packet. So if the packet that is due is
            # real, this one is not.
            due = place + due_in
            expected = self.measure(data, due)
            if expected == 0 or expected > len(data) - due:
                return None
            if expected != NO_PACKET and self.intact(data, due, expected):
                return False
        follower = self.measure(data, behind)
        if follower == NO_PACKET:
            follower = self.other_record(data, behind)
        if follower == NO_PACKET:
            # This packet may be the proof of another one.
            self._other_end = behind - at
        return None if follower == 0 else follower != NO_PACKET
