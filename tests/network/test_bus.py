"""From zenoh's thread to the event loop: nothing waits for ever, and what is too much is counted."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any

import pytest

from lidario.network import bus as module
from lidario.network.bus import Bus, Sample


class Bytes:
    """Bytes as zenoh gives them."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def to_bytes(self) -> bytes:
        return self._data


class Arrived:
    """A message as zenoh gives it; while it is looked at, the loop may run."""

    def __init__(self, payload: bytes, meanwhile: Callable[[], object] = lambda: None) -> None:
        self.payload = Bytes(payload)
        self.attachment = None
        self._meanwhile = meanwhile

    @property
    def key_expr(self) -> str:
        self._meanwhile()
        return "a"


class Session:
    """A session of zenoh that does nothing but remember who subscribed."""

    info: Any

    def __init__(self) -> None:
        self.info = self
        self.receive: Callable[[Any], None] = print

    def declare_transport_events_listener(self, changed: object) -> object:
        return changed

    def declare_subscriber(self, key: str, receive: Callable[[Any], None]) -> object:
        self.receive = receive
        return key


async def test_a_message_that_comes_while_the_last_one_is_taken_is_taken_too() -> None:
    """Zenoh's thread and the loop's may be anywhere when the other one goes on."""
    session, taken = Session(), list[Sample]()
    bus = Bus(session, "tcp/localhost:7447")
    due: list[Callable[[], None]] = []
    bus._loop = _Loop(due)  # type: ignore[assignment]
    bus.subscribe("a", taken.append)

    def run() -> None:
        while due:
            due.pop(0)()

    session.receive(Arrived(b"1"))
    session.receive(Arrived(b"2", run))
    run()
    assert [each.payload for each in taken] == [b"1", b"2"]


async def test_what_waits_is_bounded_by_its_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_WAITING_BYTES", 100 + 2 * module.OVERHEAD)
    session, taken = Session(), list[Sample]()
    bus = Bus(session, "tcp/localhost:7447")
    bus.subscribe("a", taken.append)
    for number in range(5):
        session.receive(Arrived(bytes([number]) * 40))
    session.receive(Arrived(b"x" * 400))
    session.receive(Arrived(b"y"))
    assert bus.dropped == 6
    await asyncio.sleep(0)
    assert [each.payload for each in taken] == [b"y"]
    monkeypatch.setattr(module, "MOST_WAITING_BYTES", 1 << 20)
    for number in range(600):
        session.receive(Arrived(b""))
        if number == 300:
            await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert (len(taken), bus.dropped) == (601, 6)


async def test_what_is_dropped_while_it_is_taken_is_no_error() -> None:
    """Zenoh's thread may drop the very message that the loop has just seen."""
    inbox = module._Inbox(print)

    class Meanwhile(deque[Sample]):
        def __bool__(self) -> bool:
            there = len(self) > 0
            self.clear()
            return there

    inbox._waiting = Meanwhile([Sample("a", b"1", b"")])
    inbox.hand_over()


async def test_messages_without_a_byte_are_bounded_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_WAITING_BYTES", 100 * module.OVERHEAD)
    inbox = module._Inbox(print)
    assert sum(inbox.put(Sample("a", b"", b"")) for _ in range(150)) == 50


class _Loop:
    def __init__(self, due: list[Callable[[], None]]) -> None:
        self._due = due

    def call_soon_threadsafe(self, callback: Callable[..., None], *values: Any) -> None:
        self._due.append(lambda: callback(*values))
