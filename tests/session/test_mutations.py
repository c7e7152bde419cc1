"""The matrix of two tasks turns red when the fix for one of its rows is taken out, so it is known to look."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.readiness import Readiness
from lidario.session.talking.stopper import Stopper
from tests.session import test_slow_responses as slow
from tests.session.test_two_tasks import (
    Work,
    ask,
    ask_while_scanning,
    b_closes,
    b_stops,
    silent_cell,
    start,
    two_tasks,
)
from tests.support.devices import make_rig
from tests.support.loop import run_driven

pytestmark = pytest.mark.discards("the fixes that keep it from that are taken out")


def without_the_pause_behind_a_request(patch: pytest.MonkeyPatch) -> None:
    """It is not noted when the device listens again, nor is a quiet line waited for behind STOP.

    One of the two is enough: the line has to be quiet for longer than the device is deaf.
    """

    async def not_drained(self: Dialogue, *, stop: bool = True) -> bool:
        if stop:
            await self._until_it_listens()
            self.write((self.device.stop(),))
        self.link.drained()
        return True

    patch.setattr(Readiness, "pause", lambda self, settle: None)
    patch.setattr(Dialogue, "quieten", not_drained)


def without_the_end_of_a_start(patch: pytest.MonkeyPatch) -> None:
    """`StreamControl.unwant` does not end the start in progress."""
    patch.setattr(Dialogue, "interrupt", lambda self, error: None)


def without_the_timer_of_the_stop_requests(patch: pytest.MonkeyPatch) -> None:
    """`Stopper.try_now` writes them now or never."""
    try_now = Stopper.try_now

    def now_or_never(self: Stopper) -> None:
        try_now(self)
        self.cancel()

    patch.setattr(Stopper, "try_now", now_or_never)


@pytest.mark.parametrize(
    ("take_out", "a", "b"),
    [
        (without_the_pause_behind_a_request, ask_while_scanning, b_stops),
        (without_the_end_of_a_start, start, b_stops),
        (without_the_timer_of_the_stop_requests, start, b_stops),
    ],
    ids=lambda each: each.__name__,
)
@pytest.mark.parametrize("family", ["rplidar"])
def test_the_matrix_notices(
    family: str, take_out: Callable[[pytest.MonkeyPatch], None], a: Work, b: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    two_tasks(family, a, b, 0)
    take_out(monkeypatch)
    with pytest.raises(AssertionError, match=f"{a.__name__} x {b.__name__}"):
        two_tasks(family, a, b, 0)


def test_the_matrix_notices_where_the_device_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an end of the waiting, a question goes on until it has waited long enough for its response."""
    monkeypatch.setattr("lidario.session.talking.waiting.Waiting._raise", lambda self, error: None)
    with pytest.raises(AssertionError, match=r"ask x b_closes at step .*: it waited for"):
        two_tasks("rplidar", ask, b_closes, 1, silent_cell)


@pytest.mark.parametrize("family", ["rplidar", "ydlidar"])
def test_slow_responses_show_where_a_quiet_line_is_believed(family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A device that owes a response is quiet, and has not heard the stop requests."""
    delay_s, moment_s = (0.2, 5.23) if family == "rplidar" else (1.5, 0.02)
    run_driven(lambda: slow.both(make_rig(family), delay_s, slow.start, slow.b_stops, moment_s))
    monkeypatch.setattr(Readiness, "owes_until", 0.0)
    with pytest.raises(AssertionError):
        run_driven(lambda: slow.both(make_rig(family), delay_s, slow.start, slow.b_stops, moment_s))
