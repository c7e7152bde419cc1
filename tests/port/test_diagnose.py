"""Why a port would not open: the operating system's words, turned into a cause and a cure."""

from __future__ import annotations

import errno
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
import serial

from lidario.port.diagnose import busy, holders, is_pseudo_terminal, why_not_opened


@pytest.mark.parametrize(
    ("error", "reason", "says"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file"), "missing", "no such port"),
        (serial.SerialException(errno.ENOENT, "could not open"), "missing", "no such port"),
        (OSError(errno.ENXIO, "No such device"), "missing", "no such port"),
        (PermissionError(errno.EACCES, "denied"), "permission", "no permission for"),
        (OSError(errno.EBUSY, "busy"), "busy", "is busy"),
        (serial.SerialException("Could not exclusively lock port"), "busy", "is busy"),
        (serial.SerialException("Could not configure port: (25, 'x')"), "missing", "not a serial port"),
        (ValueError("something else"), "missing", "something else"),
    ],
)
def test_each_cause_has_its_word(error: Exception, reason: str, says: str) -> None:
    failed = why_not_opened("/dev/ttyUSB0", error)
    assert failed.reason == reason
    assert says in str(failed)
    assert "/dev/ttyUSB0" in str(failed)


def test_the_cure_for_a_forbidden_port_names_its_group(tmp_path: Path) -> None:
    port = tmp_path / "port"
    port.touch()
    failed = why_not_opened(str(port), PermissionError(errno.EACCES, "denied"))
    assert "usermod -aG" in str(failed)
    assert "log out and in" in str(failed)


def test_who_holds_a_port_is_named() -> None:
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    assert is_pseudo_terminal(path)
    assert list(holders(path)) == []
    program = "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print(flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", program, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        other.stdout.readline()
        assert [pid for pid, _ in holders(path)] == [other.pid]
        failed = busy(path)
        assert failed.reason == "busy"
        assert f"held by PID {other.pid} (" in str(failed)
    os.close(master)
    os.close(slave)
    assert "another program" in str(busy("/no/such/port"))
