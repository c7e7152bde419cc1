"""The system gives no more files, or no more memory: each call names that, and the cure, once."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest
import serial

import lidario
from lidario import CannotRecord, ConnectFailed, open_lidar
from lidario.cli.errors import report
from lidario.port.diagnose import why_not_opened
from lidario.recording import record
from lidario.session.talking.trouble import mistake_of_ours
from tests.cli.processes import run
from tests.support.children import ROOT
from tests.support.loop import driven

S2 = "sim://rplidar-s2?via=memory"
NO_FILES = r"this program may open no more files: `ulimit -n`, or LimitNOFILE of its service, says how many"
NO_MEMORY = "no memory is left"
LEFT = [
    (OSError(errno.EMFILE, os.strerror(errno.EMFILE), "/usr/lib/idna.py"), NO_FILES),
    (MemoryError("Unable to allocate 128. KiB"), NO_MEMORY),
]
what_is_left = pytest.mark.parametrize(("error", "told"), LEFT, ids=["files", "memory"])


def failing(error: Exception) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_of_a_port() -> None:
    """pyserial names the number of the error twice."""
    error = serial.SerialException(errno.EMFILE, "could not open port /dev/ttyUSB0: [Errno 24] Too many open files")
    assert str(why_not_opened("/dev/ttyUSB0", error)) == f"could not open '/dev/ttyUSB0': {NO_FILES}"


@what_is_left
@driven
async def test_of_a_module_loaded_at_opening(error: Exception, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.session.opening.anyio.CancelScope", failing(error))
    with pytest.raises(ConnectFailed) as caught:
        await open_lidar(S2)
    assert str(caught.value) == f"{S2}: {told}"


@what_is_left
@driven
async def test_of_a_recording(error: Exception, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its thread loads ``mcap``."""
    path = tmp_path / "a.mcap"
    async with open_lidar(S2) as lidar:
        monkeypatch.setattr(record, "Parts", failing(error))
        with pytest.raises(CannotRecord) as caught:
            await lidar.record(path).start()
    assert str(caught.value) == f"{path} cannot be written: {told}"


@what_is_left
def test_of_the_command(error: Exception, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    report(error)
    assert capsys.readouterr().err == f"error: {told}\n"


def test_lack_of_memory_is_no_mistake_of_ours(caplog: pytest.LogCaptureFixture) -> None:
    failure = mistake_of_ours("lidario failed at what the device sent", MemoryError())
    assert isinstance(failure, lidario.InternalError)
    assert str(failure) == f"lidario failed at what the device sent: {NO_MEMORY}"
    assert not caplog.records


@pytest.mark.long
def test_a_package_that_cannot_be_loaded_is_told_in_a_line(tmp_path: Path) -> None:
    """As numpy, which tells a page of what may be wrong, and loads far more than anything before it."""
    (tmp_path / "numpy.py").write_text(
        "try:\n    raise ImportError('libstdc++.so.6: failed to map segment')\n"
        "except ImportError as error:\n    raise ImportError('a page of advice') from error\n"
    )
    places = os.pathsep.join((str(tmp_path), str(ROOT)))
    done = run("info", S2, environment={"PYTHONPATH": places})
    assert done.returncode == 1
    assert done.stderr.startswith("error: the command cannot be loaded: libstdc++.so.6: failed to map segment. Is")
    assert done.stderr.count("\n") == 1
    assert "Traceback" in run("info", S2, "--traceback", environment={"PYTHONPATH": places}).stderr
