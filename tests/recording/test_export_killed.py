"""An export that is ended by a signal leaves nothing: Linux has files without a name, by /proc/self/fd."""

import os
import signal
from pathlib import Path

import pytest

from lidario import CannotRecord
from lidario.recording.export import write_whole
from tests.support.children import BOUND, child, finished, line_of, started

WRITES = """
import sys, time
from pathlib import Path
from lidario.recording.export import write_whole
with write_whole(Path(sys.argv[1]), overwrite=True) as part:
    part.write_bytes(b"half of")
    print(flush=True)
    # One long nap would not be ended by a signal that the system gives to another thread, such as one of numpy's.
    while True:
        time.sleep(0.01)
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "before"),
    [(signal.SIGTERM, None), (signal.SIGINT, b"the old one"), (signal.SIGKILL, b"the old one")],
)
def test_a_signal_leaves_nothing(tmp_path: Path, number: signal.Signals, before: bytes | None) -> None:
    path = tmp_path / "run.npz"
    if before is not None:
        path.write_bytes(before)
    with child(WRITES, str(path)) as writing:
        line_of(writing.stdout)
        writing.send_signal(number)
        assert writing.wait(BOUND) != 0
    assert [each.name for each in tmp_path.iterdir()] == ([] if before is None else [path.name])
    if before is not None:
        assert path.read_bytes() == before


@pytest.mark.parametrize("has_nameless", [True, False])
@pytest.mark.parametrize("before", [None, b"the old one"], ids=["new", "replaced"])
def test_it_appears_when_it_is_whole_as_any_new_file(
    tmp_path: Path, has_nameless: bool, before: bytes | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, other = tmp_path / "run.npz", tmp_path / "other"
    other.write_bytes(b"")
    if before is not None:
        path.write_bytes(before)
    if not has_nameless:
        monkeypatch.delattr(os, "O_TMPFILE")
    with write_whole(path, overwrite=True) as part:
        part.write_bytes(b"half of")
        assert (path.read_bytes() if path.exists() else None) == before
        part.write_bytes(b"the new one")
    assert path.read_bytes() == b"the new one"
    assert path.stat().st_mode == other.stat().st_mode
    with pytest.raises(CannotRecord, match="exists already"), write_whole(path, overwrite=False):
        pass
    with pytest.raises(ZeroDivisionError), write_whole(path, overwrite=True) as part:
        part.write_bytes(b"half of")
        raise ZeroDivisionError
    assert path.read_bytes() == b"the new one"
    assert sorted(tmp_path.iterdir()) == [other, path]


WAITS = """
import os, sys, time
from lidario.cli.export import processes
if __name__ == "__main__":
    with processes(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        for _ in range(3):
            pool.submit(time.sleep, 600)
        if sys.argv[1:]:
            time.sleep(600)
        raise KeyboardInterrupt
"""


DEAF = """
import signal
from lidario.cli.export import begun, processes
def blocks():
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
if __name__ == "__main__":
    with processes(2) as pool:
        print(blocks(), *(each.result() for each in begun(pool, [blocks] * 3)))
"""


def written(folder: Path, program: str) -> str:
    """A program as a file: processes that are spawned need it."""
    path = folder / "program.py"
    path.write_text(program)
    return str(path)


@pytest.mark.long
def test_ctrl_c_does_not_wait_for_the_files_of_other_processes(tmp_path: Path) -> None:
    assert finished(written(tmp_path, WAITS)).stderr.endswith("KeyboardInterrupt\n")


@pytest.mark.long
def test_ctrl_c_which_a_terminal_sends_to_all_is_for_the_command_alone(tmp_path: Path) -> None:
    """A process that is about to begin would end with a traceback."""
    assert finished(written(tmp_path, DEAF)).stdout == "False True True True\n"


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_other_processes_and_leaves_nothing(tmp_path: Path, number: signal.Signals) -> None:
    """Python told of semaphores that had leaked."""
    with started(written(tmp_path, WAITS), "on") as process:
        line_of(process.stdout)
        process.send_signal(number)
        _, said = process.communicate(timeout=BOUND)
        assert said.endswith(f"Stopped: stopped by signal {int(number)}\n")
        assert "leaked" not in said


@pytest.mark.long
def test_when_it_is_killed_no_other_process_goes_on(tmp_path: Path) -> None:
    with started(written(tmp_path, WAITS), "on") as process:
        line_of(process.stdout)
        process.kill()
        # It ends when nobody can write to it any more.
        assert line_of(process.stdout) == ""


@pytest.mark.parametrize("exists", [True, False])
def test_a_link_stays_a_link(tmp_path: Path, exists: bool) -> None:
    """As to a disk with more room."""
    (tmp_path / "disk").mkdir()
    target, link = tmp_path / "disk" / "run.npz", tmp_path / "run.npz"
    if exists:
        target.write_bytes(b"the old one")
    link.symlink_to(target)
    with write_whole(link, overwrite=exists) as part:
        part.write_bytes(b"the new one")
    assert link.is_symlink()
    assert target.read_bytes() == b"the new one"
    assert sorted(os.listdir(tmp_path)) == ["disk", "run.npz"]
    assert os.listdir(tmp_path / "disk") == ["run.npz"]
