"""From zenoh's thread to the event loop: nothing waits for ever, and what is too much is counted."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from lidario.network import bus as module
from lidario.network import handover
from lidario.network.bus import OPEN_S, Bus, Sample

ROUTER = "tcp/192.0.2.7:7447"


class Bytes:
    """Bytes as zenoh gives them."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def to_bytes(self) -> bytes:
        return self._data

    def __len__(self) -> int:
        return len(self._data)


class Arrived:
    """A message as zenoh gives it; while it is looked at, the loop may run."""

    kind = "PUT"

    def __init__(self, payload: bytes, meanwhile: Callable[[], object] = lambda: None) -> None:
        self.payload = Bytes(payload)
        self.attachment = None
        self.parameters = ""
        self.name = "a"
        self._meanwhile = meanwhile

    @property
    def key_expr(self) -> str:
        self._meanwhile()
        return self.name

    @property
    def ok(self) -> Arrived:
        return self

    def reply(self, key: str, payload: bytes) -> None: ...

    def drop(self) -> None: ...


class Session:
    """A session of zenoh that does nothing but remember who subscribed, and closes once it is `released`."""

    info: Any

    def __init__(self) -> None:
        self.info = self
        self.receive: Callable[[Any], None] = print
        self.released = threading.Event()
        self.released.set()  # what a test leaves open is closed when the process ends
        self.asked = 0

    def liveliness(self) -> Session:
        return self

    def declare_transport_events_listener(self, changed: object) -> object:
        return changed

    def declare_subscriber(self, key: str, receive: Callable[[Any], None], *, history: bool = False) -> object:
        self.receive = receive
        return key, history

    def declare_queryable(self, key: str, receive: Callable[[Any], None]) -> object:
        self.receive = receive
        return key

    def close(self) -> None:
        self.released.wait()

    def get(self, key: str, replies: object, **options: object) -> Iterator[Arrived]:
        while True:
            self.asked += 1
            yield Arrived(bytes(100))


async def test_a_message_that_comes_while_another_is_taken_is_taken_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Zenoh's thread and the loop's may be anywhere when the other one goes on."""
    session, taken = Session(), list[Sample]()
    due: list[Callable[[], None]] = []
    with monkeypatch.context() as patch:
        patch.setattr(asyncio, "get_running_loop", lambda: _Loop(due))
        bus = Bus(session, ROUTER)
    bus.subscribe("a", taken.append)

    def run() -> None:
        while due:
            due.pop(0)()

    session.receive(Arrived(b"1"))
    session.receive(Arrived(b"2", run))
    run()
    assert [each.payload for each in taken] == [b"1", b"2"]


async def test_what_waits_is_bounded_by_its_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handover, "MOST_WAITING_BYTES", 100 + 2 * handover.ITEM_BYTES)
    session, taken = Session(), list[Sample]()
    bus = Bus(session, ROUTER)
    bus.subscribe("a", taken.append)
    for number in range(5):
        session.receive(Arrived(bytes([number]) * 40))
    session.receive(Arrived(b"x" * 400))
    session.receive(Arrived(b"y"))
    assert bus.dropped == 6
    await asyncio.sleep(0)
    assert [each.payload for each in taken] == [b"y"]
    monkeypatch.setattr(handover, "MOST_WAITING_BYTES", 1 << 20)
    for number in range(600):
        session.receive(Arrived(b""))
        if number % 200 == 0:
            await asyncio.sleep(0)
    while len(taken) < 601:
        await asyncio.sleep(0)
    assert bus.dropped == 6


async def test_what_queries_carry_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is kept whole until it is responded to, and anybody may ask with mebibytes."""
    monkeypatch.setattr(handover, "MOST_WAITING_BYTES", 4 * (module.QUERY_BYTES + handover.ITEM_BYTES))
    session, asked = Session(), list[bytes]()
    bus = Bus(session, ROUTER)

    def response() -> bytes:
        asked.append(b"")
        return b""

    bus.respond("a", response)
    for size in (0, module.QUERY_BYTES, 3 * module.QUERY_BYTES, 0):
        session.receive(Arrived(bytes(size)))
    assert bus.dropped == 3
    await asyncio.sleep(0)
    assert len(asked) == 1


async def test_a_message_or_a_key_that_is_too_long_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_MESSAGE_BYTES", 1000)
    session, taken = Session(), list[Sample]()
    bus = Bus(session, ROUTER)
    bus.subscribe("a", taken.append)
    long = Arrived(b"")
    long.name = "k" * (module.LONGEST_KEY + 1)
    for each in (Arrived(bytes(1001)), long, Arrived(bytes(1000))):
        session.receive(each)
    await asyncio.sleep(0)
    assert [len(each.payload) for each in taken] == [1000]
    assert bus.dropped == 2


@pytest.mark.parametrize("what", ["samples", "tokens", "queries"])
async def test_a_turn_of_the_loop_takes_a_bounded_time(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """However fast they come: zenoh's thread adds two for each one that is taken."""
    session, taken, turns, now = Session(), 0, 0, 0
    monkeypatch.setattr("lidario.network.handover.time.monotonic_ns", lambda: now)
    bus = Bus(session, ROUTER)

    def take(*_: object) -> None:
        nonlocal taken, now
        taken += 1
        now += 20_000
        if taken < 20_000:
            session.receive(Arrived(b""))
            session.receive(Arrived(b""))

    def response() -> bytes:
        take()
        return b""

    if what == "samples":
        bus.subscribe("a", take)
    elif what == "tokens":
        bus.watch_tokens("a", take)
    else:
        bus.respond("a", response)
    session.receive(Arrived(b""))
    while taken < 20_000:
        before = taken
        await asyncio.sleep(0)
        turns += 1
        assert taken - before <= handover.TURN_NS // 20_000
    assert turns >= 20_000 * 20_000 // handover.TURN_NS


async def test_work_that_takes_long_is_done_over_several_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    session, now, done = Session(), 0, list[str]()
    bus = Bus(session, ROUTER)
    monkeypatch.setattr("lidario.network.handover.time.monotonic_ns", lambda: now)

    def work(sample: Sample) -> Iterator[None]:
        nonlocal now
        for step in range(4):
            now += handover.TURN_NS // 2
            done.append(f"{sample.payload.decode()}{step}")
            yield

    bus.subscribe("a", work)
    session.receive(Arrived(b"x"))
    session.receive(Arrived(b"y"))
    seen = []
    while len(done) < 8:
        await asyncio.sleep(0)
        seen.append(len(done))
    assert done == ["x0", "x1", "x2", "x3", "y0", "y1", "y2", "y3"]
    assert seen[-4:] == [2, 4, 6, 8]


async def test_a_failure_of_ours_keeps_nothing_from_being_taken() -> None:
    session, taken, told = Session(), list[Sample](), list[object]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(context.get("exception")))
    bus = Bus(session, ROUTER)

    def take(sample: Sample) -> None:
        taken.append(sample)
        if len(taken) == 1:
            raise ZeroDivisionError

    bus.subscribe("a", take)
    for number in range(3):
        session.receive(Arrived(bytes([number])))
        await asyncio.sleep(0)
    assert [each.payload for each in taken] == [b"\0", b"\1", b"\2"]
    assert [type(each) for each in told] == [ZeroDivisionError]


async def test_what_is_dropped_while_it_is_taken_is_no_error() -> None:
    """Zenoh's thread may drop the very message that the loop has just seen."""
    taken, due = list[str](), list[Callable[[], None]]()
    inbox = handover.Handover[str](taken.append, due.append)
    inbox.put("a", 1)
    (asked,) = due
    for _ in range(2):
        asked()
    assert (taken, due) == (["a"], [asked])


async def test_the_responses_to_a_query_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_REPLY_BYTES", 10 * (handover.ITEM_BYTES + 101))
    session = Session()
    bus = Bus(session, ROUTER)
    found = await bus.query("a", 1.0)
    assert len(found) == 10
    assert session.asked < 20


class _Loop:
    def __init__(self, due: list[Callable[[], None]]) -> None:
        self._due = due

    def call_soon_threadsafe(self, callback: Callable[..., None], *values: Any) -> None:
        self._due.append(lambda: callback(*values))

    def call_soon(self, callback: Callable[..., None], *values: Any) -> None:
        self.call_soon_threadsafe(callback, *values)


async def test_leaving_a_router_that_does_not_respond_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.router.CLOSE_S", 0.02)
    session = Session()
    session.released.clear()
    try:
        async with asyncio.timeout(30):
            await Bus(session, ROUTER).close()
    finally:
        session.released.set()


@pytest.mark.parametrize("file", ["", '{mode: "peer", scouting: {multicast: {enabled: true}}}'], ids=["", "a file"])
async def test_only_the_router_that_was_named_is_connected_to(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, file: str
) -> None:
    """Whatever the environment names as configuration."""
    monkeypatch.delenv("ZENOH_CONFIG", raising=False)
    if file:
        (tmp_path / "zenoh.json5").write_text(file)
        monkeypatch.setenv("ZENOH_CONFIG", str(tmp_path / "zenoh.json5"))
    opened = Mock(return_value=Session())
    monkeypatch.setattr("zenoh.open", opened)
    await Bus.open(ROUTER)
    (config,) = opened.call_args.args
    assert config.get_json("mode") == '"client"'
    assert config.get_json("connect/endpoints") == f'["{ROUTER}"]'
    assert config.get_json("scouting/multicast/enabled") == "false"
    # A program that has not closed it waits so long at its end; and no thread is left in zenoh behind `OPEN_S`.
    assert float(config.get_json("transport/unicast/open_timeout")) < 1e3 * OPEN_S
