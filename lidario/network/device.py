"""A lidar of another machine, as the session sees it: it responds what it has told, and nothing can be set.

It is a `RecordedDevice`: the scripts of the family run on the responses that its publisher has passed on. A stream
of whole scans has no packets, and its format says so.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, TypeVar, cast

from lidario.basics.model import DeviceInfo, Health, ScanMode
from lidario.errors import Unsupported
from lidario.families.base import Decoder, Family, Script, Stream
from lidario.recording.about import About
from lidario.recording.chronicle import EventState, Responded, StreamBegan, StreamEvent
from lidario.recording.device import RecordedDevice
from lidario.recording.read import Piece, StoredStream, StoredStreams
from lidario.wire.envelope import Request
from lidario.wire.events import Packets
from lidario.wire.formats import NO_PACKET, Headings, StreamFormat

T = TypeVar("T")

NO_MODE: Final = 1 << 16
"""The number of a mode that is not known, above those that devices give: 0 is that of a real one."""
LONGEST_RESPONSE: Final = 4096
"""Bytes of a response that is remembered, and of its request; a length in a request is one byte."""


class RemoteStreams(StoredStreams):
    """What is known of the lidar: what a `RecordedDevice` needs. The stream that runs is the only one of `streams`.

    The session has `opened` one; another one may run since. Bytes arrive (`raw`), or whole scans.
    """

    def __init__(
        self, family: Family, about: About, modes: tuple[ScanMode, ...], began: StreamBegan, *, raw: bool
    ) -> None:
        super().__init__(Path())
        self.raw: bool = raw
        self._told = EventState()
        self.responses: dict[bytes, Responded] = self._told.responses
        self.about = about
        self.modes: tuple[ScanMode, ...] = modes
        self.streams = ((StoredStream if raw else _WholeScans)(family, began),)
        self.opened: StreamBegan = began
        for event in about.events:
            self.learn(event)

    @property
    def stream(self) -> StoredStream:
        """The stream that runs."""
        return self.streams[0]

    def pieces(self) -> Iterator[Piece]:
        """Nothing is stored."""
        return iter(())

    def learn(self, event: StreamEvent) -> None:
        """Remember what the device responded."""
        if isinstance(event, Responded) and len(event.request) + len(event.payload) <= LONGEST_RESPONSE:
            self._told.follow(event)

    def turn(self, degrees: float) -> None:
        """The stream that runs has another zero-angle offset now."""
        before = self.stream.began
        self.begin(replace(before, zero_offset_deg=degrees))
        if self.opened is before:
            self.opened = self.stream.began

    def begin(self, began: StreamBegan) -> None:
        """Another stream runs now."""
        self.streams: tuple[StoredStream, ...] = (replace(self.stream, began=began),)


class RemoteDevice(RecordedDevice):
    """The lidar of another machine."""

    told_by = "its publisher"
    whose = "another machine's lidar"

    def __init__(self, streams: RemoteStreams) -> None:
        super().__init__(streams, lambda: streams.stream)
        self._streams = streams
        self.sends_bytes: bool = streams.raw
        self._foreign = streams.about.info.family != streams.stream.family.name

    def reset(self) -> Request:
        """As `Device.reset`; raises Unsupported."""
        raise Unsupported(f"{self.whose} cannot be reset from here")

    def identify(self) -> Script[DeviceInfo]:
        """What its publisher told. The other scripts of a family rely on this one of its own having run."""
        yield from super().identify()
        return self._streams.about.info

    def health(self) -> Script[Health]:
        """As `Device.health`: what was told last."""
        yield from ()
        return self._streams.about.health

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        """The scan modes, the one that runs marked as the typical one."""
        if self.sends_bytes:
            return (yield from super().modes())
        running = self._streams.stream.began.mode
        others = [replace(mode, typical=False) for mode in self._streams.modes if mode.id != running.id]
        # The one that runs is the only one to be had; it is not known while the publisher's lidar stands still.
        return (replace(running, typical=True), *others)

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """As `Device.start`: in the mode that runs, also where its publisher has chosen another one since.

        Raises:
            Unsupported: Another mode is asked for, or `force` is set.
        """
        began = self._streams.stream.began
        self._streams.opened = began
        # The typical one was the one that ran when it was asked which there are.
        if force or not (mode.typical or mode.id == began.mode.id):
            raise Unsupported(
                f"this lidar is driven by its publisher, in mode {began.mode.name!r}: nothing can be set from here"
            )
        stream = yield from super().start(began.mode)
        return replace(stream, mode=replace(stream.mode, typical=True))

    def _recall(self, script: Script[T], what: str) -> Script[T]:
        if self._foreign:
            # The scripts of our families would assume what holds for their own devices.
            script.close()
            raise Unsupported(f"{self.told_by} does not tell {what}: it is a node of ROS 2, or another version")
        return super()._recall(script, what)

    def set_scan_frequency(self, hertz: float) -> Script[float]:  # noqa: ARG002
        raise Unsupported(f"the scan frequency of {self.whose} cannot be set from here")

    def apply_zero_offset(self, on: bool) -> Script[float]:
        """As `Device.apply_zero_offset`; raises Unsupported where whole scans arrive."""
        if not self.sends_bytes:
            raise Unsupported("the zero-angle offset of these scans was chosen by their publisher")
        return super().apply_zero_offset(on)


def whole_scans(mode: ScanMode | None) -> StreamBegan:
    """What there is to say of a stream that has no packets; the mode is None where it is not known."""
    known = mode or ScanMode(NO_MODE, "LaserScan", 0.0, 0.0, 0)
    return StreamBegan(0, b"", known, 1, known.sample_us * 1e3, 1.0, 0, 0, 0.0)


class ScanMessages(StreamFormat):
    """The format of a stream of whole scans: there are no packets, and every byte is noise."""

    name = "scan messages"
    response_type = 0
    header: re.Pattern[bytes] = re.compile(rb"(?!)")
    shortest = longest = samples = 1
    full_turn = 360

    def measure(self, data: bytearray, at: int) -> int:  # noqa: ARG002
        return NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        return False

    def headings(self, packets: Packets) -> Headings:  # noqa: ARG002
        return []


class _NoPackets:
    """The decoder of a stream without packets: there is nothing to decode."""

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:
        pass


class _WholeScans(StoredStream):
    """A stream whose scans arrive whole."""

    def _format(self) -> tuple[StreamFormat, Decoder]:
        return ScanMessages(), cast("Decoder", _NoPackets())
