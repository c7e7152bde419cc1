"""Packets that divide a revolution into equal slots, each of which says where it is: what is missing, and decoding.

Such a device measures at angles and not at times: its packets cover the same angle at any speed. So nothing has to
be learned of the rotor. What the next packet is ahead of one slot was lost.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Decoded
from lidario.families.spans import Arcs, Heads, SteadyArcs, spans_between
from lidario.wire.events import Arrival, Packets

__all__ = ["FIRST", "FULL_TURN", "DegreeDecoder", "Returns", "SlotDecoder", "SlotWheel"]

FULL_TURN: Final = 360
"""360 degrees in degrees."""
FIRST: Final = 0xA0
"""The number of the first packet of a revolution, in the second byte; so it is in all known devices."""


class SlotWheel:
    """Judges packets of equal slots; obeys `Turning`. It remembers nothing.

    Args:
        full_turn: 360 degrees in the unit of the headings.
        slots: How many packets a revolution has.
    """

    def __init__(self, full_turn: int, slots: int) -> None:
        self._full_turn = full_turn
        self._slots = slots
        self._slot = full_turn // slots

    def tell_time(self, sample_ns: float) -> None:
        """As `Turning.tell_time`: it is not needed."""

    def copy(self) -> Self:
        """As `Turning.copy`."""
        return self

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:  # noqa: ARG002
        """As `Turning.follow`."""
        spans, _, greatest, _ = spans_between(heads, self._full_turn, 0)
        count = len(spans)
        arcs = np.full(count, self._slot, np.int32)
        step = self._full_turn / (self._slots * heads.samples / count)
        if greatest <= self._slot:
            return Arcs(arcs, None, step, certain=True)
        missing = np.maximum(np.rint(spans / self._slot) - 1, 0) * heads.counts
        return Arcs(arcs, missing.astype(np.intp), step, certain=True)

    def steady(
        self,
        heads: Heads,  # noqa: ARG002
        ends: Sequence[int],  # noqa: ARG002
        arrivals: Sequence[Arrival] = (),  # noqa: ARG002
    ) -> SteadyArcs | None:
        """As `Turning.steady`: None, since what a sample takes differs from revolution to revolution."""
        return None

    def settle(self, arcs: SteadyArcs, arrivals: Sequence[Arrival] = ()) -> None:
        """As `Turning.settle`: nothing is remembered."""


class Returns(NamedTuple):
    """What packets hold, shape (packets, samples) each.

    Attributes:
        distance: Millimetres; 0 where nothing came back.
        strength: Of the returns, 0 to 255.
    """

    distance: NDArray[np.integer[Any]]
    strength: NDArray[np.integer[Any]]


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
    def _rpm(self, read: Any) -> NDArray[np.float64]:
        """The speed that each packet tells, revolutions a minute, by `Heads.read`."""

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:
        return float(self._rpm(heads.read[begin:end]).mean())

    def _sample_ns(self, heads: Heads) -> float:
        count = len(heads.first)
        self._speeds = np.concatenate((self._speeds, self._rpm(heads.read)))[-max(count, self._slots) :]
        self._counts = np.concatenate((self._counts, np.broadcast_to(heads.counts, count)))[-len(self._speeds) :]
        turn = float(self._speeds.mean()) * float(self._counts.mean()) * self._slots
        return 60e9 / turn if turn else 0.0


class DegreeDecoder(SlotDecoder):
    """Decodes packets of one size whose samples stand at whole degrees, counted as the rotor turns.

    Args:
        packet: Layout of a packet, with the field ``number``.
        samples: Samples of each, a degree apart.
        back: Whether the rotor turns counter-clockwise.
    """

    def __init__(self, packet: np.dtype[Any], samples: int, *, back: bool = False) -> None:
        super().__init__(FULL_TURN, FULL_TURN // samples)
        self._packet = packet
        self._each = samples
        self._back = back

    @abstractmethod
    def _returns(self, rows: NDArray[Any]) -> Returns:
        """What came back."""

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        rows = np.frombuffer(packets.data, self._packet)
        after = None if following is None else (following[1] - FIRST) * self._each
        return Heads((rows["number"].astype(np.int32) - FIRST) * self._each, after, self._each, None, rows)

    def _samples(
        self,
        packets: Packets,  # noqa: ARG002
        heads: Heads,
        arcs: Arcs,  # noqa: ARG002
        ends: Sequence[int],
        room: int,
    ) -> Decoded:
        size, rows = room + ends[-1], (-1, self._each)
        angle, distance = np.empty(size, np.float32), np.empty(size, np.float32)
        intensity = np.empty(size, np.uint8)
        returns = self._returns(heads.read)
        distance[room:].reshape(rows)[...] = returns.distance
        intensity[room:].reshape(rows)[...] = returns.strength
        turned = heads.first[:, None] + np.arange(self._each)
        angle[room:].reshape(rows)[...] = -turned % FULL_TURN if self._back else turned
        return Decoded(angle, distance, intensity)
