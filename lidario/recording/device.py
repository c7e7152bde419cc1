"""A recorded device: it responds what the real one had responded, through the family's own code.

The scripts of the family run as with a live device; each request gets its response from the recording,
without a line and without waiting. What was never asked while it was recorded is not known, and nothing can be set:
both raise `Unsupported`, which says so.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

from lidario.basics.model import DeviceInfo, Health, NetworkAddress, SampleRate, ScanMode
from lidario.errors import RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Device, Script, Stream
from lidario.recording.chronicle import Responded
from lidario.recording.read import StoredStream, StoredStreams
from lidario.wire.envelope import Expected, Request

T = TypeVar("T")

PLAY = b"play"  # what the request to play consists of; no device is there to read it


class RecordedDevice(Device):
    """The device of a recording; `current` tells which stream is played next.

    What its errors call it is `told_by` and `whose`.
    """

    told_by: str = "the recording"
    whose: str = "a recording"

    def __init__(self, recording: StoredStreams, current: Callable[[], StoredStream]) -> None:
        self._recording = recording
        self._current = current
        self._device = recording.streams[0].family.device()
        self._offset_deg: float | None = None

    def stop(self) -> Request:
        return self._device.stop()

    def reset(self) -> Request:
        """As `Device.reset`; the recording is played on after it."""
        return self._device.reset()

    def identify(self) -> Script[DeviceInfo]:
        """What it had said it is."""
        try:
            return (yield from self._recall(self._device.identify(), "its information"))
        except Unsupported:
            # What it has assumed in vain does not hold.
            self._device = self._recording.streams[0].family.device()
            return self._recording.about.info

    def health(self) -> Script[Health]:
        """As `Device.health`: the latest one of the recording."""
        try:
            return (yield from self._recall(self._device.health(), "its health"))
        except Unsupported:
            return self._recording.about.health

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        """As `Device.modes`; the one that is played first counts as the typical one."""
        played = {stream.began.mode.id: stream.began.mode for stream in self._recording.streams}
        try:
            known = yield from self._recall(self._device.modes(), "its scan modes")
        except Unsupported:
            known = ()
        first = self._recording.streams[0].began.mode.id
        # What was recorded goes before what a family assumes where it is told nothing.
        every = {**{mode.id: mode for mode in known}, **played}
        return tuple(replace(mode, typical=mode.id == first) for mode in every.values())

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """As `Device.start`: the stream that comes next in the recording, whatever mode the one before had.

        Raises:
            Unsupported: No stream of the recording has that mode.
        """
        recorded = {stream.began.mode.id: stream.began.mode.name for stream in self._recording.streams}
        if mode.id not in recorded:
            names = ", ".join(recorded.values())
            raise Unsupported(f"the recording has no scans in mode {mode.name!r}; it has {names}")
        if force:
            raise Unsupported("a recording cannot be forced to scan")
        current = self._current()
        stream = current.open()
        expected = Expected(current.began.mode.response_type, current.began.packet_size, continuous=True)
        yield Request("PLAY", PLAY, expected, stream=stream.format)
        return replace(stream, zero_offset_deg=self.offset_of(stream.zero_offset_deg))

    def sample_rate(self) -> Script[SampleRate]:
        return self._recall(self._device.sample_rate(), "its sample rate")

    def scan_frequency(self) -> Script[float]:
        return self._recall(self._device.scan_frequency(), "its scan frequency")

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        return self._recall(self._device.scan_frequency_range(), "its range of scan frequencies")

    def set_scan_frequency(self, hertz: float) -> Script[float]:  # noqa: ARG002
        raise Unsupported("the scan frequency of a recording cannot be set; ?rate=2 plays it faster")

    def zero_offset(self) -> Script[float]:
        return self._recall(self._device.zero_offset(), "its zero-angle offset")

    def apply_zero_offset(self, on: bool) -> Script[float]:
        """As `Device.apply_zero_offset`; before it is called, what was chosen while it was recorded holds."""
        self._offset_deg = (yield from self.zero_offset()) if on else 0.0
        return self._offset_deg

    def offset_of(self, recorded_deg: float) -> float:
        """The zero-angle offset to add where the recording has that one."""
        return recorded_deg if self._offset_deg is None else self._offset_deg

    def network_address(self) -> Script[NetworkAddress]:
        return self._recall(self._device.network_address(), "its network address")

    def set_network_address(self, address: NetworkAddress) -> Script[None]:  # noqa: ARG002
        raise Unsupported(f"the network address of {self.whose} cannot be set from here")

    def power_down_protection(self, on: bool) -> Script[bool]:  # noqa: ARG002
        raise Unsupported(f"power-down protection of {self.whose} cannot be switched from here")

    def _recall(self, script: Script[T], what: str) -> Script[T]:
        """Run a script of the family on the responses of the recording."""
        yield from ()
        return recalled(script, self._recording.responses, f"{self.told_by} does not tell {what}")


def recalled(script: Script[T], responses: Mapping[bytes, Responded], otherwise: str) -> T:
    """Run a script on the latest responses to requests, without a device.

    Raises:
        Unsupported: A response is missing, or cannot be read; the text begins with `otherwise`.
    """
    try:
        request = next(script)
        while True:
            found = responses.get(request.data)
            if found is None and request.expects is not None:
                request = script.throw(ResponseTimeout(request.name, 0.0))
            else:
                request = script.send(b"" if found is None else found.payload)
    except StopIteration as stop:
        result: T = stop.value
        return result
    except ResponseTimeout:
        raise Unsupported(f"{otherwise}: the device was not asked for it") from None
    except (RemoteProtocolError, ValueError, LookupError, ArithmeticError, struct.error) as error:
        # Scripts rely on lengths that were checked when the response was received.
        raise Unsupported(f"{otherwise}: what it holds cannot be read") from error
