"""A simulated device behind another object, for those that change what it hears or says."""

from __future__ import annotations

from typing import Any

from lidario.sim.device import Received


class Relayed:
    """Passes everything on, both ways; obeys `lidario.sim.device.SimulatedDevice`.

    Args:
        device: The device at the other end.
        step_ns: While it scans it has something to say only so often: fewer deliveries make a day shorter.

    Attributes:
        device: The device at the other end.
    """

    def __init__(self, device: Any, step_ns: int = 1) -> None:
        self.device: Any = device
        self._step_ns = step_ns

    @property
    def baudrate(self) -> int:
        return int(self.device.baudrate)

    @property
    def log(self) -> list[Received]:
        return list(self.device.log)

    @property
    def scanning(self) -> bool:
        return bool(self.device.scanning)

    @property
    def motor_on(self) -> bool:
        return bool(self.device.motor_on)

    def receive(self, data: bytes, now: int) -> None:
        self.device.receive(data, now)

    def transmit(self, now: int) -> bytes:
        return bytes(self.device.transmit(now))

    def wakeup(self, now: int) -> int | None:
        """As the device, at whole steps."""
        return self._in_steps(self.device.wakeup(now))

    def _in_steps(self, at: int | None) -> int | None:
        return at if at is None or not self.scanning else -(-at // self._step_ns) * self._step_ns
