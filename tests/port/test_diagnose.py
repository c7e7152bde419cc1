"""Why a port would not open: the operating system's words, turned into a cause and a cure."""

import errno
import os
import stat
from types import SimpleNamespace

import pytest
import serial

from lidario.port.diagnose import busy, holders, is_pseudo_terminal, why_not_opened
from tests.support.ports import another_program, terminal_pair

NOT_THERE = "FileNotFoundError(2, 'The system cannot find the file specified.', None, 2)"
DENIED = "PermissionError(13, 'Access is denied.', None, 5)"


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
        # As serialwin32.py of pyserial raises them.
        (serial.SerialException("could not open port 'COM3': " + NOT_THERE), "missing", "no such port"),
        (serial.SerialException("could not open port 'COM3': " + DENIED), "busy", "is busy"),
    ],
)
def test_each_cause_has_its_word(error: Exception, reason: str, says: str) -> None:
    failed = why_not_opened("/dev/ttyUSB0", error)
    assert failed.reason == reason
    assert says in str(failed)
    assert "/dev/ttyUSB0" in str(failed)


def owned(gid: int, mode: int) -> os.stat_result:
    """What the system says of a character device of that group."""
    return os.stat_result((stat.S_IFCHR | mode, 0, 0, 1, 0, gid, 0, 0, 0, 0))


@pytest.mark.parametrize(
    ("gid", "mode", "says", "never"),
    [
        (20, 0o660, ["group people", "you are not in it", "usermod -aG people", "log out"], "chmod"),
        (30, 0o660, ["group mine", "you are in it", "sudo chmod a+rw /dev/ttyUSB0"], "usermod"),
        (20, 0o600, ["group people, mode 600", "sudo chmod a+rw", "udev", 'GROUP="dialout"'], "usermod"),
        (0, 0o660, ["group root", "sudo chmod a+rw", "udev", 'GROUP="dialout"'], "usermod"),
        (987654, 0o660, ["group number 987654", "sudo chmod a+rw", "udev"], "usermod"),
    ],
)
def test_the_cure_for_a_forbidden_port(
    monkeypatch: pytest.MonkeyPatch, gid: int, mode: int, says: list[str], never: str
) -> None:
    groups = {0: "root", 20: "people", 30: "mine"}
    with monkeypatch.context() as patch:
        patch.setattr("grp.getgrgid", lambda number: SimpleNamespace(gr_name=groups[number]))
        patch.setattr(os, "getgroups", lambda: [30])
        patch.setattr(os, "stat", lambda path: owned(gid, mode))
        failed = why_not_opened("/dev/ttyUSB0", PermissionError(errno.EACCES, "denied"))
    assert failed.reason == "permission"
    for words in says:
        assert words in str(failed)
    assert never not in str(failed)


@pytest.mark.parametrize("number", [errno.EACCES, errno.EINVAL, errno.ENXIO, errno.ETXTBSY])
@pytest.mark.parametrize(
    ("kind", "called"),
    [
        (stat.S_IFREG, "a file"),
        (stat.S_IFDIR, "a directory"),
        (stat.S_IFIFO, "a pipe (FIFO)"),
        (stat.S_IFSOCK, "a socket"),
        (stat.S_IFBLK, "a device for disks"),
    ],
)
def test_what_is_no_port_is_called_by_its_name_and_no_one_is_told_to_open_it_to_everybody(
    kind: int, called: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or to join the group disk."""
    with monkeypatch.context() as patch:
        patch.setattr(os, "stat", lambda path: os.stat_result((kind | 0o660, 0, 0, 1, 0, 6, 0, 0, 0, 0)))
        failed = why_not_opened("/dev/sda", OSError(number, os.strerror(number)))
    assert f"/dev/sda is {called} and not a serial port" in str(failed)
    assert "sudo" not in str(failed)
    assert failed.reason == "missing"


def test_who_holds_a_port_is_named() -> None:
    with terminal_pair() as (_, slave, path):
        # It was told to stop another program.
        assert "this program has it open already" in str(busy(path))
        os.close(slave)
        assert is_pseudo_terminal(path)
        assert list(holders(path)) == []
        assert "another program" in str(busy(path))
        with another_program(path) as other:
            assert [pid for pid, _ in holders(path)] == [other.pid]
            failed = busy(path)
            assert failed.reason == "busy"
            assert f"held by PID {other.pid} (" in str(failed)
    assert "another program" in str(busy("/no/such/port"))


@pytest.mark.parametrize("others", [[(7, "lidario-guard"), (8, "rviz2")], [(8, "rviz2"), (9, "lidario-guard")]])
def test_the_program_is_named_not_its_guard(others: list[tuple[int, str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.port.diagnose.holders", lambda path: iter(others))
    assert "held by PID 8 (rviz2)" in str(busy("/dev/ttyUSB0"))
