"""The scripts of the 4ROS: against the simulated device through a real `Link`, and against a function."""

from collections.abc import Callable
from typing import TypeVar

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.families.ydlidar.device import YdlidarDevice
from lidario.families.ydlidar.simulated.device import Simulated4Ros
from lidario.wire.envelope import Request
from lidario.wire.events import Packets, Response
from lidario.wire.link import Link

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
        try:
            request = next(script)
            while True:
                try:
                    payload = self.ask(request)
                except ResponseTimeout as timeout:
                    request = script.throw(timeout)
                else:
                    request = script.send(payload)
        except StopIteration as stop:
            value: T = stop.value
            return value

    def sent(self) -> list[str]:
        return [received.name for received in self.simulated.log]


def played(script: Script[T], answer: Callable[[Request], bytes | None]) -> T:
    """Run a script against a function; None is silence."""
    try:
        request = next(script)
        while True:
            payload = answer(request)
            if payload is None:
                request = script.throw(ResponseTimeout(request.name, request.timeout))
            else:
                request = script.send(payload)
    except StopIteration as stop:
        value: T = stop.value
        return value
