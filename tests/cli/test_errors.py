"""Every error has its exit code, and its text looks as it should."""

import signal

import click
import pytest

import lidario
from lidario.cli.errors import Stopped, exit_code, report
from lidario.cli.streams import ReaderGone


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (lidario.ConnectFailed("x", reason="missing"), 3),
        (lidario.ConnectFailed("x", reason="ambiguous"), 3),
        (lidario.ConnectFailed("x", reason="refused"), 3),
        (lidario.ConnectFailed("x", reason="permission"), 4),
        (lidario.ConnectFailed("x", reason="busy"), 4),
        (lidario.ConnectFailed("x", reason="silent"), 5),
        (lidario.ConnectFailed("x", reason="source"), 2),
        (lidario.DeviceLost("x"), 5),
        (lidario.StreamFailed("x"), 5),
        (lidario.InternalError("x"), 1),
        (lidario.InvalidValue("x"), 2),
        (lidario.ResponseTimeout("get_info", 1.0), 5),
        (lidario.RemoteProtocolError("x"), 5),
        (lidario.LocalProtocolError("x"), 5),
        (lidario.DeviceFault("x", lidario.Health(lidario.HealthStatus.ERROR, 1)), 6),
        (lidario.Unsupported("x"), 2),
        (click.UsageError("x"), 2),
        (ReaderGone(), 0),
        (KeyboardInterrupt(), 130),
        (click.Abort(), 130),
        (Stopped(signal.SIGINT), 130),
        (Stopped(signal.SIGTERM), 143),
        (lidario.SessionClosed("x"), 1),
        (ValueError("x"), 1),
        (OSError("x"), 1),
    ],
)
def test_exit_codes(error: BaseException, code: int) -> None:
    assert exit_code(error) == code


@pytest.mark.parametrize("error", [ReaderGone(), Stopped(2), KeyboardInterrupt(), click.Abort()])
def test_what_was_meant_is_not_complained_of(error: BaseException, capsys: pytest.CaptureFixture[str]) -> None:
    report(error)
    assert capsys.readouterr().err == ""
