"""A simulated device behind a line that can be damaged and mended while a session is open.

A ``sim://`` source has its faults from the beginning to the end. Here they come and go: `damage` begins one, `mend`
ends it and gives the device its power back where it needs that.
"""

from __future__ import annotations

import random
from typing import Any

from benchmarks.relayed import Relayed
from lidario.sim.faults import Faults, parse_faults
from lidario.sim.memory import MemoryLine

MODELS = {
    "rplidar": ("rplidar-s2", "rplidar-s2", "rplidar-s1", "rplidar-s3", "rplidar-hq", "rplidar-ultra"),
    "ydlidar": ("ydlidar-4ros", "ydlidar-4ros", "ydlidar-4ros-92", "ydlidar-4ros-slow", "ydlidar-4ros-stamps"),
}
"""What is simulated in each family; the first twice as often."""

DAMAGES = (
    "drop:0.01%",
    "drop:2%",
    "flip:0.1%",
    "flip:5%",
    "insert:0.1%",
    "burst:0.1%",
    "duplicate:0.1%",
    "babble:2000",
    "babble:60000",
    "garbage",
    "late:40ms",
    "late:700ms",
    "stall:300ms",
    "silent:0s",
    "unplug:0s",
    "replug:0s",
    "reboot:0s",
    "freeze:0s",
    "protect:0s",
    "wrong-response:20%",
    "wrong-response:100%",
)
"""Every fault that the simulator knows, most of them weak and strong. Their times count from `BadLine.damage`."""


def draw_damage(random_: random.Random) -> str:
    """One fault, or two at once."""
    first = random_.choice(DAMAGES)
    if random_.random() < 0.8:
        return first
    second = random_.choice([each for each in DAMAGES if each.partition(":")[0] != first.partition(":")[0]])
    return f"{first},{second}"


class BadLine(Relayed):
    """A simulated device as the session sees it; obeys `lidario.sim.device.SimulatedDevice`.

    Args:
        device: As for `Relayed`.
        step_ns: Likewise.

    Attributes:
        fault: What is wrong at the moment, as it is typed; empty when nothing is.
    """

    def __init__(self, device: Any, step_ns: int) -> None:
        super().__init__(device, step_ns)
        self.fault = ""
        self._line = MemoryLine(device)
        self._faults: Faults | None = None

    @property
    def protected(self) -> bool:
        """Whether a device stops by itself when its host falls silent."""
        return bool(getattr(self.device, "protected", False))

    def damage(self, fault: str, seed: int, now: int) -> None:
        """Begin a fault, in place of the one before."""
        self.fault = fault
        self._faults = parse_faults(fault, seed=seed)
        self._line = MemoryLine(self.device, self._faults)
        self._faults.begin(now)

    def mend(self, now: int) -> None:
        """End the fault; what is under way on the line is lost. A device that froze is switched off and on."""
        if "freeze" in self.fault:
            self.device.reboot(now)
        if "protect" in self.fault:
            self.device.faults_cleared_by_reset = True
        self.device.wrong_responses = 0.0
        self.fault, self._faults = "", None
        self._line = MemoryLine(self.device)

    def receive(self, data: bytes, now: int) -> None:
        """As `SimulatedDevice.receive`; raises OSError while the cable is out."""
        self._check_cable(now)
        self._line.write(data, now)

    def transmit(self, now: int) -> bytes:
        """As `SimulatedDevice.transmit`; raises OSError while the cable is out."""
        data = self._line.read(now)
        self._check_cable(now)
        return data

    def wakeup(self, now: int) -> int | None:
        return self._in_steps(self._line.wakeup(now))

    def _check_cable(self, now: int) -> None:
        if self._line.unplugged(now) or (self._faults is not None and self._faults.unplugged(now)):
            raise OSError("the line was unplugged")
