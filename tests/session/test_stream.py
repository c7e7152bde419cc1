"""Mailboxes and the hub, without a device."""

import asyncio
import gc
from typing import Any

import numpy as np
import pytest

from lidario import DeviceLost, Scan
from lidario.session.streaming.readers import Hub
from lidario.session.streaming.stream import Mailbox


def numbered(seq: int) -> Scan:
    nothing: Any = np.zeros(0, np.float32)
    return Scan(nothing, nothing, None, 0, 0, 0, 0, 600.0, seq, 0, 0, "Standard")


@pytest.mark.parametrize("depth", [1, 2, 5])
async def test_the_latest_win_and_the_rest_are_counted(depth: int) -> None:
    mailbox = Mailbox[Scan](depth)
    assert sum(mailbox.put(numbered(seq)) for seq in range(10)) == 10 - depth == mailbox.total_dropped
    got = [await mailbox.get() for _ in range(depth)]
    assert [scan.seq for scan in got] == list(range(10 - depth, 10))
    assert mailbox.dropped == 10 - depth


async def test_an_ended_mailbox_gives_what_it_holds_first() -> None:
    mailbox, error = Mailbox[Scan](2), DeviceLost("gone")
    mailbox.put(numbered(0))
    mailbox.end(error)
    mailbox.end()
    assert mailbox.put(numbered(1)) == 0
    assert (await mailbox.get()).seq == 0
    for _ in range(2):
        with pytest.raises(DeviceLost, match="gone") as caught:
            await mailbox.get()
        assert caught.value.__traceback__ is not None
    # The finalizer of a stream holds the mailbox: what the mailbox holds must not lead back to the stream.
    assert error.__traceback__ is None


@pytest.mark.parametrize("waited_s", [0.0, 600.0])
async def test_a_reader_that_only_the_loop_holds_is_not_collected(waited_s: float) -> None:
    """Neither the first time nor later, and however long it waits."""
    mailbox, got = Mailbox[Scan](1), list[int]()

    async def read() -> None:
        for _ in range(3):
            got.append((await mailbox.get()).seq)

    asyncio.ensure_future(read())  # noqa: RUF006 - that is the point
    for seq in range(3):
        await asyncio.sleep(waited_s)
        gc.collect()
        mailbox.put(numbered(seq))
        await asyncio.sleep(0.001)
    assert got == [0, 1, 2]


async def test_waiting_for_many_scans_makes_no_timer_for_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cancelled ones stay in the loop's heap for a while, and every other timer is compared with them."""
    loop, mailbox, made = asyncio.get_running_loop(), Mailbox[Scan](1), list[float]()
    call_at = loop.call_at

    def counted(when: float, *rest: Any, **named: Any) -> asyncio.TimerHandle:
        made.append(when)
        return call_at(when, *rest, **named)

    monkeypatch.setattr(loop, "call_at", counted)
    for seq in range(20):
        loop.call_soon(mailbox.put, numbered(seq))
        assert (await mailbox.get()).seq == seq
    assert len(made) == 1


async def test_who_wants_what_runs_joins_at_once_unless_others_wait() -> None:
    """Those who come later must not get scans of a mode for which they did not wait."""
    hub, (reading, joins, chooses, follows) = Hub(print), (Mailbox[Scan](1) for _ in range(4))

    def waiting() -> list[Mailbox[Scan]]:
        return [each.mailbox for each in hub.joining]

    hub.add(reading, None, False)
    assert (waiting(), hub.readers) == ([reading], {})
    hub.joining.clear()
    hub.let_in(reading)
    for mailbox, mode in ((joins, None), (chooses, "Standard"), (follows, None)):
        hub.add(mailbox, mode, False)
    assert (waiting(), len(hub)) == ([chooses, follows], 4)
    hub.discard(chooses)
    hub.discard(joins)
    assert (waiting(), len(hub)) == ([follows], 2)


async def test_each_reader_gets_an_error_of_its_own() -> None:
    hub, mailboxes = Hub(print), [Mailbox[Scan](1), Mailbox[Scan](1)]
    for mailbox in mailboxes:
        hub.let_in(mailbox)
    gone, cause = DeviceLost("gone"), OSError("unplugged")
    gone.__cause__ = cause
    hub.end(gone)
    errors = []
    for mailbox in mailboxes:
        with pytest.raises(DeviceLost) as caught:
            await mailbox.get()
        errors.append(caught.value)
    assert len({id(each) for each in (*errors, gone)}) == 3
    assert errors[0].__cause__ is errors[1].__cause__ is cause
