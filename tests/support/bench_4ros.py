"""The scripts of the 4ROS against the simulated device, through a real `Link`."""

from contextlib import suppress
from typing import TypeVar

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.families.ydlidar.device import YdlidarDevice
from lidario.families.ydlidar.simulated.device import Simulated4Ros
from lidario.wire.envelope import Request
from lidario.wire.events import Packets, Response
from lidario.wire.link import Link
from tests.support.scripts import played

T = TypeVar("T")
MS = 1_000_000


class Bench:
    """Host and simulated device on one table, with a clock that is moved by hand."""

    def __init__(self, simulated: Simulated4Ros) -> None:
        self.simulated = simulated
        self.device = YdlidarDevice()
        self.link = Link()
        self.now = 10**9
        self.packets: list[Packets] = []
        self.answers: list[bytes] = []

    def pass_time(self, seconds: float) -> None:
        end = self.now + round(seconds * 1e9)
        while self.now < end:
            self.now = min(self.now + MS, end)
            self.link.receive_data(self.simulated.transmit(self.now), self.now)
            for event in self.link.events_received():
                if isinstance(event, Packets):
                    self.packets.append(event)
                elif isinstance(event, Response):
                    self.answers.append(event.payload)
                else:
                    self.answers.append(b"")

    def send(self, request: Request) -> None:
        self.link.send_request(request)
        self.simulated.receive(request.data, self.now)

    def ask(self, request: Request) -> bytes:
        for _ in range(request.attempts):
            self.answers.clear()
            self.send(request)
            if request.expects is None:
                self.pass_time(request.settle)
                return b""
            deadline = self.now + round(request.timeout * 1e9)
            while not self.answers and self.now < deadline:
                self.pass_time(0.001)
            self.link.forget()
            if self.answers:
                return self.answers[0]
        raise ResponseTimeout(request.name, request.timeout)

    def run(self, script: Script[T]) -> T:
        def answer(request: Request) -> bytes | None:
            with suppress(ResponseTimeout):
                return self.ask(request)
            return None

        return played(script, answer)

    def sent(self) -> list[str]:
        return [received.name for received in self.simulated.log]
