"""Opening a serial port: what is none, what is held, off the event loop, and cancelled on the way."""

import asyncio
import errno
import os
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest
import serial

from lidario.errors import ConnectFailed
from lidario.port.serial import open_serial
from tests.support.loop import until
from tests.support.ports import PATIENCE_S, another_program, open_files


async def failure(path: str, baudrate: int = 115200) -> ConnectFailed:
    """How opening `path` fails; leaves nothing open."""
    before = open_files()
    with pytest.raises(ConnectFailed) as caught:
        await open_serial(path, baudrate)
    assert open_files() == before
    return caught.value


@pytest.mark.parametrize(
    ("path", "says"),
    [
        ("/dev/\0x", "no such port"),
        ("", "no such port"),
        ("/dev/no-such-port", "no such port"),
        ("/dev/null/port", "no such port"),
        ("/dev/" + "x" * 5000, "no such port"),
        ("/dev", "/dev is a directory and not a serial port"),
        ("/dev/null", "not a serial port"),
        ("/dev/null", "set up as one: Inappropriate ioctl for device. `lidario devices`"),
        ("/etc/hostname", "is a file and not a serial port"),
        ("/etc/hostname", "a recording ends with .mcap or .bin"),
        ("null", "'null'. Did you mean /dev/null?"),
        ("rplidar-s2", "'rplidar-s2'. The simulated lidar of that name is sim://rplidar-s2"),
        ("/dev/\udcff", "no such port"),
        (os.path.realpath(sys.executable), "is a file and not a serial port"),  # the system says: text file busy
        ("192.168.0.7:20108", "A lidar on the network is tcp://192.168.0.7:20108 or udp://192.168.0.7:20108"),
    ],
)
async def test_what_is_no_serial_port_says_so(path: str, says: str) -> None:
    failed = await failure(path)
    assert says in str(failed)
    assert failed.reason == "missing"


async def test_a_speed_that_no_port_has(terminal: tuple[int, str]) -> None:
    assert "could not open" in str(await failure(terminal[1], 2**40))


async def test_dev_null_is_no_serial_port_even_while_others_hold_it() -> None:
    with another_program(stderr=subprocess.DEVNULL):
        failed = await failure("/dev/null")
    assert "not a serial port" in str(failed)
    assert "busy" not in str(failed)


@pytest.mark.parametrize(
    ("call", "number", "reason"),
    [("open", errno.EACCES, "permission"), ("reset_input_buffer", errno.EIO, "missing")],
)
async def test_what_is_forbidden_or_cannot_be_set_up_is_closed(
    call: str, number: int, reason: str, terminal: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: serial.Serial) -> None:
        raise serial.SerialException(number, f"could not open port: {os.strerror(number)}")

    monkeypatch.setattr(serial.Serial, call, fail)
    assert (await failure(terminal[1])).reason == reason


class SlowOpening:
    """Has pyserial take as long to open a port as the test likes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.begun = threading.Event()
        self.go_on = threading.Event()
        self.opened: list[serial.Serial] = []
        self.thread: threading.Thread | None = None
        original = serial.Serial.open

        def opening(device: serial.Serial) -> None:
            self.thread = threading.current_thread()
            self.begun.set()
            assert self.go_on.wait(PATIENCE_S)
            original(device)
            self.opened.append(device)

        monkeypatch.setattr(serial.Serial, "open", opening)


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[SlowOpening]:
    opening = SlowOpening(monkeypatch)
    yield opening
    opening.go_on.set()


async def test_the_list_of_processes_is_read_off_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    readers: list[threading.Thread] = []

    def held(path: str) -> bool:
        readers.append(threading.current_thread())
        return False

    monkeypatch.setattr("lidario.port.serial.held", held)
    await failure("/dev/no-such-port")
    assert len(readers) == 1
    assert readers[0] is not threading.current_thread()


async def test_cancelled_while_it_opens_leaves_nothing_open(terminal: tuple[int, str], slow: SlowOpening) -> None:
    """The loop goes on meanwhile."""
    before = open_files()
    task = asyncio.create_task(open_serial(terminal[1], 115200))
    await until(slow.begun.is_set)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    slow.go_on.set()
    await until(lambda: slow.opened and not slow.opened[0].is_open and not (slow.thread and slow.thread.is_alive()))
    assert open_files() == before
