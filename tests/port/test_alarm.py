"""Sleeping until a time that is put off, or brought forward, meanwhile."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from lidario.port.alarm import Alarm, TimerAlarm, make_alarm
from tests.support.ports import PATIENCE_S

both = pytest.mark.parametrize("make", [Alarm, TimerAlarm])


@contextmanager
def waited_for(alarm: Alarm) -> Iterator[threading.Thread]:
    """A thread that waits for it, and ends; in the end it is time."""
    waiting = threading.Thread(target=alarm.wait, daemon=True)
    waiting.start()
    try:
        yield waiting
    finally:
        alarm.set(time.monotonic())
        waiting.join(PATIENCE_S)
        alarm.close()
    assert not waiting.is_alive()


@both
def test_it_wakes_at_its_time_and_not_earlier(make: Callable[[], Alarm]) -> None:
    alarm = make()
    for pause in (0.0, -1.0, 0.02):
        at = time.monotonic() + pause
        alarm.set(at)
        alarm.wait()
        assert time.monotonic() >= alarm.at == at
    alarm.close()


@both
def test_an_earlier_time_ends_a_wait_that_has_begun(make: Callable[[], Alarm]) -> None:
    alarm = make()
    alarm.set(time.monotonic() + 3600.0)
    with waited_for(alarm) as waiting:
        alarm.set(time.monotonic() + 0.001)
        waiting.join(PATIENCE_S)
        assert not waiting.is_alive()


@both
def test_one_that_is_put_off_does_not_wake_also_where_its_time_had_come(make: Callable[[], Alarm]) -> None:
    alarm = make()
    alarm.set(time.monotonic() - 1.0)
    alarm.set(time.monotonic() + 3600.0)
    with waited_for(alarm) as waiting:
        waiting.join(0.02)
        assert waiting.is_alive()


@pytest.mark.parametrize("error", [OSError("too many open files"), MemoryError()])
def test_where_the_system_gives_no_timer_the_thread_wakes_to_look(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    alarm = make_alarm()
    assert isinstance(alarm, TimerAlarm)
    alarm.close()

    def refused() -> Alarm:
        raise error

    monkeypatch.setattr("lidario.port.alarm.TimerAlarm", refused)
    assert type(make_alarm()) is Alarm
