"""A line without a clock and without a thread; the servers of `lidario.sim.serve` are built on it as well.

Here the two kinds of faults meet: device faults happen at their time, between two bytes of the device, and line
faults change the bytes on their way to the host.
"""

from typing import Final

from lidario.sim.device import SimulatedDevice
from lidario.sim.faults import Faults

TICK_S: Final = 0.002
"""Time between two readings of a device that sends."""


class MemoryLine:
    """The line between a host and a simulated device; the caller passes the time.

    Raises:
        ValueError: The faults are not possible with this device.
    """

    def __init__(self, device: SimulatedDevice, faults: Faults | None = None) -> None:
        self.device = device
        self._faults = Faults() if faults is None else faults
        self._left = bytearray()  # left the device before a device fault and was not read yet
        self._cable: int | None = None
        self._read_ns: int | None = None  # when it was read last
        self._faults.check(device)

    def write(self, data: bytes, now: int) -> None:
        """The host's bytes arrive at the device at `now`; they are lost while the cable is out."""
        self._faults.begin(now)
        self._let_faults_happen(now)
        if not self._faults.unplugged(now):
            self.device.receive(data, now)

    def set_dtr(self, asserted: bool, now: int) -> None:
        """The host sets DTR; it means something to few devices."""
        self._tell("set_dtr", asserted, now)

    def set_baudrate(self, baudrate: int, now: int) -> None:
        """The host sets the speed of its port; few devices notice."""
        self._tell("set_host_baudrate", baudrate, now)

    def read(self, now: int) -> bytes:
        """What has arrived at the host since the last call."""
        begin, self._read_ns = self._read_ns, now
        if not self._faults.babble or begin is None:
            return self._read(now)
        # Noise comes between the bytes of the device, however seldom they are read.
        tick_ns = round(TICK_S * 1e9)
        return b"".join([self._read(at) for at in (*range(begin + tick_ns, now, tick_ns), now)])

    def _read(self, now: int) -> bytes:
        self._let_faults_happen(now)
        data = bytes(self._left) + self.device.transmit(now)
        self._left.clear()
        return self._faults.apply(data, now)

    def wakeup(self, now: int) -> int | None:
        """When `read` or `unplugged` will next have something to tell; None while nothing is under way."""
        if self._left:
            return now
        times = (self.device.wakeup(now), self._faults.wakeup(now), self._faults.next_at)
        return max(now, min(known)) if (known := [each for each in times if each is not None]) else None

    def unplugged(self, now: int) -> bool:
        """Whether this line is dead by `now`; after a replug it stays so, and a new line works."""
        cable = self._faults.cable(now)
        if self._cable is None:
            self._cable = cable
        if cable != self._cable or self._faults.unplugged(now):
            return True
        # A device that brings its own faults tells it itself.
        tells = getattr(self.device, "unplugged", None)
        return tells is not None and bool(tells(now))

    def _tell(self, method: str, state: int, now: int) -> None:
        """Tell the device what the host has set, where it has a method for that, or passes on what it is asked."""
        told = getattr(self.device, method, None)
        if callable(told):
            told(state, now)

    def _let_faults_happen(self, now: int) -> None:
        while (at := self._faults.next_at) is not None and at <= now:
            self._left += self.device.transmit(at)
            self._faults.strike(self.device)
            if self._faults.unplugged(at):
                self._left.clear()
