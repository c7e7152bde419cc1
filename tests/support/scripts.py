"""Running a family's scripts by hand: no link, no device, only responses."""

from collections.abc import Callable, Mapping
from typing import TypeVar

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.wire.envelope import Request

T = TypeVar("T")
Answers = Mapping[bytes, bytes | None]
"""Bytes of a request -> payload of its response; None or absent: silence."""


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


def drive(script: Script[T], answers: Answers) -> tuple[T, list[Request]]:
    """Run a script against a device that gives these responses; its result, and what it sent."""
    sent: list[Request] = []

    def answer(request: Request) -> bytes | None:
        sent.append(request)
        waits = request.expects is not None and request.stream is None
        return answers.get(request.data) if waits else b""

    return played(script, answer), sent
