"""Running a family's scripts by hand: no link, no device, only a table of responses."""

from collections.abc import Mapping
from typing import TypeVar

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.wire.envelope import Request

T = TypeVar("T")
Answers = Mapping[bytes, bytes | None]
"""Bytes of a request -> payload of its response; None or absent: silence."""


def drive(script: Script[T], answers: Answers) -> tuple[T, list[Request]]:
    """Run a script against a device that gives these responses; its result, and what it sent."""
    sent: list[Request] = []
    try:
        request = next(script)
        while True:
            sent.append(request)
            answer = answers.get(request.data)
            if request.expects is None or request.stream is not None:
                request = script.send(b"")
            elif answer is None:
                request = script.throw(ResponseTimeout(request.name, request.timeout))
            else:
                request = script.send(answer)
    except StopIteration as stop:
        return stop.value, sent
