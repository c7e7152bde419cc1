"""The scripts of the 4ROS against the simulated device, with a clock that is moved by hand."""

from typing import TypeVar

from lidario.families.base import Script
from lidario.families.ydlidar.device import YdlidarDevice
from lidario.families.ydlidar.simulated.device import Simulated4Ros
from lidario.wire.envelope import DESCRIPTOR_SIZE, Request
from tests.support.scripts import played

T = TypeVar("T")
MS = 1_000_000


class Bench:
    """Host and simulated device on one table."""

    def __init__(self, simulated: Simulated4Ros) -> None:
        self.simulated = simulated
        self.device = YdlidarDevice()
        self.now = 10**9

    def pass_time(self, seconds: float) -> bytes:
        """What comes meanwhile."""
        self.now += round(seconds * 1e9)
        return self.simulated.transmit(self.now)

    def ask(self, request: Request) -> bytes | None:
        """The response, without its descriptor; None where none comes."""
        for _ in range(request.attempts):
            self.simulated.receive(request.data, self.now)
            if request.expects is None:
                self.pass_time(request.settle)
                return b""
            told, deadline = b"", self.now + round(request.timeout * 1e9)
            while len(told) < DESCRIPTOR_SIZE + request.expects.size and self.now < deadline:
                told += self.pass_time(0.001)
            if told:
                return told[DESCRIPTOR_SIZE:]
        return None

    def run(self, script: Script[T]) -> T:
        return played(script, self.ask)
