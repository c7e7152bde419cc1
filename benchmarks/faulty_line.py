"""A damaged line that remembers what went in and what came out, and what of it lidario should have recognised."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

from benchmarks.relayed import Relayed
from benchmarks.streams import Kind, recording
from lidario.sim.faults import Faults
from lidario.sim.memory import MemoryLine
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from lidario.wire.link import Link

_NEAR = 2000
"""Bytes; at most so far from its place a packet is searched for."""
_OF_A_REVOLUTION = 0.4
"""Part of a revolution within which it is searched for: a steady device sends the same packets in the next one."""
_AHEAD, _AHEAD_BYTES = 8, 700
"""Packets, and bytes; not both are recognised by mistake in a row. A repeated piece of a line is shorter."""


class Intact(NamedTuple):
    """What of a stream arrived whole and unchanged.

    Attributes:
        damaged: Packets sent, up to the last intact one, that are not.
        intact: Packets that are.
        passed_over: Intact ones that were not recognised.
        in_a_row: Most of these in a row.
    """

    damaged: int = 0
    intact: int = 0
    passed_over: int = 0
    in_a_row: int = 0


class Recorder(Relayed):
    """A simulated device behind a damaged line; obeys `lidario.sim.device.SimulatedDevice`.

    Args:
        device: The device.
        faults: What goes wrong.
        kind: What it sends.
    """

    def __init__(self, device: Any, faults: Faults, kind: Kind) -> None:
        super().__init__(device)
        self._kind = kind
        self._line = MemoryLine(_Tapped(device, self), faults)
        self.sent = bytearray()
        self._arrived: list[bytes] = []
        self._until = (0, 0)

    def receive(self, data: bytes, now: int) -> None:
        """As `SimulatedDevice.receive`; raises OSError while the cable is out."""
        self._line.write(data, now)
        self._check_cable(now)

    def transmit(self, now: int) -> bytes:
        """As `SimulatedDevice.transmit`; raises OSError while the cable is out."""
        data = self._line.read(now)
        self._check_cable(now)
        if data:
            self._arrived.append(data)
        return data

    def wakeup(self, now: int) -> int | None:
        return self._line.wakeup(now)

    def mark(self) -> None:
        """What counts ends here, until the next call."""
        self._until = (len(self.sent), len(self._arrived))

    def reconnect(self, faults: Faults) -> None:
        """A new line to the same device."""
        self._line = MemoryLine(self.device, faults)

    def intact(self) -> Intact:
        """What arrived intact up to the last `mark`, and what of it lidario's parser recognises."""
        played = recording(self._kind)
        near = min(_NEAR, round(_OF_A_REVOLUTION * len(played.loop) / len(played.loop_ends)))
        sent, _ = self._packets([bytes(self.sent[: self._until[0]])])
        ahead = max(_AHEAD, _AHEAD_BYTES * len(sent) // max(1, sum(map(len, sent))))
        arrived = self._arrived[: self._until[1]]
        recognised, begin = self._packets(arrived)
        raw, at, skipped, there = b"".join(arrived)[begin:], 0, 0, list[bytes | None]()
        for packet in sent:
            # Not anywhere: packets repeat with each revolution.
            found = raw.find(packet, at + max(0, skipped - near), at + skipped + near + len(packet))
            there.append(None if found < 0 else packet)
            at, skipped = (at, skipped + len(packet)) if found < 0 else (found + len(packet), 0)
        while there and there[-1] is None:
            there.pop()
        place = passed_over = row = in_a_row = 0
        for each in there:
            if each is None:
                row = 0
                continue
            here = recognised[place : place + ahead]
            if each in here:
                place += here.index(each) + 1
                row = 0
            else:
                passed_over, row = passed_over + 1, row + 1
                in_a_row = max(in_a_row, row)
        intact = sum(each is not None for each in there)
        return Intact(len(there) - intact, intact, passed_over, in_a_row)

    def _packets(self, chunks: list[bytes]) -> tuple[list[bytes], int]:
        """The packets that the parser recognises behind the descriptor of the stream, and where that ends."""
        link, wire, found, begin = Link(), self._kind.make_format(), list[bytes](), 0
        link.send_request(self._kind.request(wire))
        for chunk in chunks:
            link.receive_data(chunk, 0)
            for event in link.events_received():
                begin = begin or link.stream_at
                if isinstance(event, Packets):
                    offsets = packet_offsets(event.blocks)
                    found += [bytes(event.data[a:b]) for a, b in pairwise(offsets)]
        return found, begin

    def _check_cable(self, now: int) -> None:
        if self._line.unplugged(now):
            raise OSError("the line was unplugged")


class _Tapped:
    """The device, whose bytes are kept as they leave it; device faults reach it as itself."""

    def __init__(self, device: Any, recorder: Recorder) -> None:
        self._device = device
        self._recorder = recorder

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name.startswith("_"):
            object.__setattr__(self, name, value)
        else:
            setattr(self._device, name, value)

    def transmit(self, now: int) -> bytes:
        data: bytes = self._device.transmit(now)
        self._recorder.sent += data
        return data
