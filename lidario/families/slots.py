"""Packets that divide a revolution into equal slots, each of which says where it is: what is missing, and decoding.

Such a device measures at angles and not at times: its packets cover the same angle at any speed. So nothing has to
be learned of the rotor. What the next packet is ahead of one slot was lost.

`DegreeFormat` and `DegreeDecoder` read those whose samples stand at whole degrees behind ``FA`` and a number.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Output
from lidario.families.spans import Arcs, Heads, Turning, spans_between
from lidario.wire.events import Arrival, Packets
from lidario.wire.formats import HEADINGS_WORTH_AN_ARRAY, NO_PACKET, Headings
from lidario.wire.rows import RowFormat

__all__ = [
    "FIRST",
    "FULL_TURN",
    "HEAD",
    "DegreeDecoder",
    "DegreeFormat",
    "DegreePacket",
    "SlotDecoder",
    "SlotWheel",
]

FULL_TURN: Final = 360
"""360 degrees in degrees."""
HEAD: Final = 0xFA
FIRST: Final = 0xA0
"""The number of the first packet of a revolution, in the second byte; so it is in all known devices."""


class SlotWheel(Turning):
    """Judges packets of equal slots. It remembers nothing.

    It tells no revolutions at once: what a sample takes differs from one to the next.

    Args:
        full_turn: 360 degrees in the unit of the headings.
        slots: How many packets a revolution has.
    """

    def __init__(self, full_turn: int, slots: int) -> None:
        self._full_turn = full_turn
        self._slots = slots
        self._slot = full_turn // slots

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:  # noqa: ARG002
        spans, _, greatest, _ = spans_between(heads, self._full_turn, 0)
        count = len(spans)
        arcs = np.full(count, self._slot, np.int32)
        step = self._full_turn / (self._slots * heads.samples / count)
        if greatest <= self._slot:
            return Arcs(arcs, None, step, certain=True)
        missing = np.maximum(np.rint(spans / self._slot) - 1, 0) * heads.counts
        return Arcs(arcs, missing.astype(np.intp), step, certain=True)


class SlotDecoder(ArcDecoder):
    """Decodes packets of equal slots, each of which tells the speed: so it tells how long a sample took.

    Speeds are rounded, and how many samples a packet has may change by one from slot to slot. So that counts which
    the packets of a whole revolution tell; of a part of one, those before it too. That is all it remembers.

    Args:
        full_turn: 360 degrees in the unit of the headings.
        slots: How many packets a revolution has.
    """

    def __init__(self, full_turn: int, slots: int) -> None:
        super().__init__(full_turn, SlotWheel(full_turn, slots))
        self._slots = slots
        self._speeds = self._counts = np.empty(0)

    @abstractmethod
    def _rpm(self, heads: Heads) -> NDArray[np.float64]:
        """The speed that each packet tells, revolutions a minute."""

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:
        return float(self._rpm(heads)[begin:end].mean())

    def _sample_ns(self, heads: Heads) -> float:
        count = len(heads.first)
        self._speeds = np.concatenate((self._speeds, self._rpm(heads)))[-max(count, self._slots) :]
        self._counts = np.concatenate((self._counts, np.broadcast_to(heads.counts, count)))[-len(self._speeds) :]
        turn = float(self._speeds.mean()) * float(self._counts.mean()) * self._slots
        return 60e9 / turn if turn else 0.0


class DegreePacket(NamedTuple):
    """How packets of one size lie whose samples stand at whole degrees, counted as the rotor turns.

    Attributes:
        layout: With the fields ``number`` and ``speed``.
        samples: Samples of each, a degree apart.
        an_rpm: What a revolution a minute is in the unit of the speed.
    """

    layout: np.dtype[Any]
    samples: int
    an_rpm: float

    def rpm_of(self, packets: bytes) -> float:
        """The speed that packets tell, revolutions a minute."""
        return float(np.median(np.frombuffer(packets, self.layout)["speed"])) / self.an_rpm

    def sample_us(self, packets: bytes) -> float:
        """What a sample takes, by packets; 0 where the rotor stands."""
        rpm = self.rpm_of(packets)
        return 60e6 / (rpm * FULL_TURN) if rpm else 0.0


class DegreeFormat(RowFormat):
    """Such packets, behind `HEAD` and their number. A family adds what makes one intact.

    Attributes:
        packet: How they lie.
    """

    packet: DegreePacket
    full_turn = FULL_TURN

    def _begun(self, data: bytearray, at: int, needed: int = 2) -> int:
        """As `measure`, by the first two bytes, once `needed` bytes are there."""
        begin = data[at : at + 2]
        if begin[0] != HEAD or (len(begin) > 1 and not 0 <= begin[1] - FIRST < FULL_TURN // self.samples):
            return NO_PACKET
        return self.shortest if len(data) - at >= needed else 0

    def measure(self, data: bytearray, at: int) -> int:
        return self._begun(data, at)

    def _marked(self, rows: NDArray[Any]) -> NDArray[np.bool_]:
        """Which packets begin as one must."""
        number = rows["number"]
        is_one = (number >= FIRST) & (number < FIRST + FULL_TURN // self.samples)
        marked: NDArray[np.bool_] = (rows["mark"] == HEAD) & is_one
        return marked

    def headings(self, packets: Packets) -> Headings:
        numbers = np.frombuffer(packets.data, self.packet.layout)["number"]
        turned = (numbers.astype(np.int32) - FIRST) * self.samples
        return turned if len(turned) >= HEADINGS_WORTH_AN_ARRAY else turned.tolist()

    def told_sample_ns(self, packets: Packets) -> NDArray[np.float64]:
        rpm = np.frombuffer(packets.data, self.packet.layout)["speed"] / self.packet.an_rpm
        return 60e9 / (np.maximum(rpm, 1.0) * FULL_TURN)


class DegreeDecoder(SlotDecoder):
    """Decodes such packets.

    Args:
        packet: How they lie.
        back: Whether the rotor turns counter-clockwise.
    """

    def __init__(self, packet: DegreePacket, *, back: bool = False) -> None:
        super().__init__(FULL_TURN, FULL_TURN // packet.samples)
        self._packet = packet
        self._each = packet.samples
        self._back = back

    @abstractmethod
    def _returns(self, rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Millimetres, 0 where nothing came back, and the strength of returns, to 255; shape (packets, samples)."""

    def _rpm(self, heads: Heads) -> NDArray[np.float64]:
        speeds: NDArray[np.uint16] = heads.read["speed"]
        return speeds / np.float64(self._packet.an_rpm)

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows = np.frombuffer(packets.data, self._packet.layout)
        after = None if following is None else (following[1] - FIRST) * self._each
        return Heads((rows["number"].astype(np.int32) - FIRST) * self._each, after, self._each, None, rows)

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002
        output.distance[...], output.intensity[...] = self._returns(heads.read)
        turned = heads.first[:, None] + np.arange(self._each)
        output.angle[...] = -turned % FULL_TURN if self._back else turned
