"""The matrix of two tasks turns red when the fix for one of its rows is taken out, so it is known to look."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from lidario.session.dialogue import Dialogue
from lidario.session.stopper import Stopper
from lidario.wire.envelope import Request
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

pytestmark = pytest.mark.discards("the fixes that keep it from that are taken out")


def without_the_pause_behind_a_request(patch: pytest.MonkeyPatch) -> None:
    """`Dialogue.write` does not note when the device listens again, nor is a quiet line waited for behind STOP.

    One of the two is enough: the line has to be quiet for longer than the device is deaf.
    """
    write = Dialogue.write

    async def not_drained(self: Dialogue) -> bool:
        self._link.drained()
        return True

    def forgetful(self: Dialogue, requests: Sequence[Request]) -> None:
        listens_at = self._listens_at
        write(self, requests)
        self._listens_at = listens_at

    patch.setattr(Dialogue, "write", forgetful)
    patch.setattr(Dialogue, "drain", not_drained)


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
    monkeypatch.setattr("lidario.session.waiting.Waiting._raise", lambda self, error: None)
    with pytest.raises(AssertionError, match=r"ask x b_closes at step .*: it waited for"):
        two_tasks("rplidar", ask, b_closes, 1, silent_cell)
