"""The process of a guard: what it understands, and what it writes, on a driven clock."""

import socket
import sys
import termios
from typing import Any

import pytest

from lidario.port import guard_process


@pytest.mark.parametrize("hurried", [b"", b"hurried\n"])
@pytest.mark.parametrize("ending", [b"", b"farewell\n"])
@pytest.mark.parametrize("piece", [1, 7, 4096])
def test_what_the_process_understands(hurried: bytes, ending: bytes, piece: int) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        message = hurried + b"0.015 0.0 1 -aa 1bb\n" + ending
        for begin in range(0, len(message), piece):
            ours.send(message[begin : begin + piece])
        ours.close()
        order, handle, gives_back = guard_process.last_order(theirs)
    assert order == (None if ending else ([(b"\xbb", True)], [(b"\xaa", None)], 0.015, 0.0))
    assert (handle, gives_back) == (-1, bool(hurried))


class Clock:
    """The time, and everything that is written at a time."""

    def __init__(self, patch: pytest.MonkeyPatch, handle: int = 5) -> None:
        self.now = 100.0
        self.written: list[tuple[float, object]] = []
        self.waiting = 0
        patch.setattr("os.isatty", lambda _: True)
        patch.setattr("time.monotonic", lambda: self.now)
        patch.setattr("time.sleep", self.sleep)
        patch.setattr("os.write", lambda _, data: self.note(data))
        patch.setattr("fcntl.ioctl", self.ioctl)
        patch.setattr("termios.tcgetattr", lambda _: [0, 0, termios.HUPCL | termios.CREAD, 0, 0, 0, []])
        patch.setattr("termios.tcsetattr", lambda _, when, to: self.note(("settings", to[2])))
        patch.setattr("termios.tcflush", lambda _, queue: self.note(("flushed", queue)))

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def note(self, what: object) -> int:
        self.written.append((round(self.now - 100.0, 3), what))
        return 0

    def ioctl(self, handle: int, request: int, argument: bytes) -> bytes:
        if request == termios.TIOCOUTQ:
            return self.waiting.to_bytes(4, sys.byteorder)
        assert argument == termios.TIOCM_DTR.to_bytes(4, sys.byteorder)
        self.note({termios.TIOCMBIS: "DTR on", termios.TIOCMBIC: "DTR off"}[request])
        return b""

    def left_still(
        self,
        *orders: tuple[bytes, bool | None],
        last: guard_process.Requests | None = None,
        listens_at: float = 0.0,
    ) -> list[tuple[float, Any]]:
        guard_process.leave_still(5, (list(orders), last or [], 0.015, listens_at))
        return self.written


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def test_five_times_within_an_eighth_of_a_second(clock: Clock) -> None:
    seen = clock.left_still((b"motor", None), (b"stop", None))
    times = [at for at, data in seen if data == b"stop"]
    assert times == pytest.approx([0.0, 0.015, 0.037, 0.071, 0.122], abs=0.001)
    assert [data for _, data in seen] == [b"motor", b"stop"] * 5


def test_until_the_device_listens_and_no_longer_than_that(clock: Clock) -> None:
    times = [at for at, _ in clock.left_still((b"stop", None), listens_at=101.0)]
    assert times[-2] < 1.0 <= times[-1]
    assert times[-1] < 1.0 + 0.016


def test_not_for_ever(clock: Clock) -> None:
    assert 2.5 <= clock.left_still((b"stop", None), listens_at=1e9)[-1][0] < 2.6


OFF_BY_DTR = [("settings", termios.CREAD), "DTR on"]
"""Else the system would clear DTR when the port is closed, and the motor would turn."""


@pytest.mark.parametrize(
    ("orders", "last", "written"),
    [
        ([(b"", True), (b"stop", None)], [], [*OFF_BY_DTR, b"stop"] * 5),
        # What makes a device deaf comes last.
        ([(b"stop", None)], [(b"pwm", None), (b"", True)], [b"stop"] * 5 + [b"pwm", *OFF_BY_DTR]),
        # A motor that stops when DTR is cleared.
        ([(b"", False)], [], ["DTR off"] * 5),
        # A device that only talks.
        ([(b"", None)], [], []),
    ],
)
def test_what_is_written(
    orders: guard_process.Requests, last: guard_process.Requests, written: list[Any], clock: Clock
) -> None:
    assert [what for _, what in clock.left_still(*orders, last=last)] == written
    assert (clock.now > 100.0) is bool(written)


def test_a_connection_that_stands_is_waited_for_longer(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.isatty", lambda _: False)
    clock.waiting = 10
    clock.left_still((b"stop", None))
    assert 1.0 < clock.now - 100.0 < 1.3


def test_an_adapter_that_is_stuck_is_waited_for_shortly(clock: Clock) -> None:
    clock.waiting = 10
    seen = clock.left_still((b"stop", None))
    assert seen[-1][1] == ("flushed", termios.TCOFLUSH)
    assert seen[-1][0] < 0.3
