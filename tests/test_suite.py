"""What watches every test can itself fail: each kind of thing left behind makes a test fail."""

import os
import re
import subprocess
import sys
from asyncio import timeout
from contextlib import suppress
from pathlib import Path

import pytest

from lidario.errors import DeviceLost, LidarError
from lidario.session.opening import open_lidar
from lidario.sim.device import Received
from tests.support import leaks
from tests.support.children import child, line_of
from tests.support.devices import make_rig
from tests.support.discards import some_discarded
from tests.support.ledger import BYTES, PACKETS, assert_stats_close, ledgers_made
from tests.support.loop import driven, driven_loop, run_driven

ROOT = Path(__file__).parent.parent
PATIENCE_S = 60.0
OF_A_DEVELOPER = {"LIDAR": "/dev/ttyUSB0", "PYTHONASYNCIODEBUG": "1", "PYTHONUNBUFFERED": "1"}
CULPRITS = """
import asyncio
import os
import threading

import pytest
from hypothesis import settings

from lidario.wire.link import Link
from tests.support.devices import make_rig


def discard() -> None:
    device = make_rig("rplidar").device
    for at in (0, 1):
        device.receive(b"\\xa5\\x25", at)


def test_makes_a_device_discard() -> None:
    discard()


@pytest.mark.discards("on purpose")
def test_innocent_since_it_says_why() -> None:
    discard()


@pytest.mark.discards("on purpose, it says")
def test_needs_no_marker() -> None:
    make_rig("rplidar")


@pytest.mark.discards
def test_gives_no_reason() -> None:
    discard()


async def test_innocent_and_async() -> None:
    await asyncio.create_task(asyncio.sleep(0))


def test_leaves_a_file() -> None:
    os.open(os.devnull, os.O_RDONLY)


def test_innocent_as_in_any_environment() -> None:
    assert not {"LIDAR", "PYTHONASYNCIODEBUG", "PYTHONUNBUFFERED"} & set(os.environ)


def test_takes_one_counter_out() -> None:
    link = Link()
    link.receive_data(b"noise", 0)
    link.stats.stray_bytes = 0


def test_leaves_a_thread() -> None:
    threading.Thread(target=threading.Event().wait, args=(60,), daemon=True).start()


async def test_leaves_a_task() -> None:
    asyncio.get_running_loop().task = asyncio.create_task(asyncio.sleep(60))
"""
CAUGHT = set(re.findall(r"(?<=def )test_(?!innocent)\w+", CULPRITS))
if not Path(leaks.FOLDER).is_dir():
    CAUGHT.remove("test_leaves_a_file")  # the system does not tell


@pytest.mark.parametrize(
    ("name", "why", "mistake"),
    [
        ("get_health", "unknown to this device", False),
        ("get_info", "still booting after reset", False),
        ("express_scan", "still booting after reset", True),
        ("get_info", "within 500 ms of reset", True),
        ("get_info", "scanning", True),
    ],
)
def test_which_discarded_requests_are_mistakes(name: str, why: str, mistake: bool) -> None:
    device = make_rig("rplidar").device
    device.log.append(Received(0, name, b"", obeyed=False, why=why))
    assert some_discarded([device]) is mistake
    device.log.clear()


FAULTS = ("", "&fault=flip:0.1%", "&fault=drop:1%", "&fault=insert:0.1%", "&fault=stall:200ms", "&fault=unplug:4s")
FAULTY = [(model, fault) for fault in FAULTS for model in ("rplidar-s2", "ydlidar-4ros")]
EVERY_SECOND = [each for number, each in enumerate(FAULTY) if number % 4 in (0, 3)]
"""Every fault on one of the models, in turns."""


@pytest.mark.long
@pytest.mark.exhaustive("faulty", sample=EVERY_SECOND, full=FAULTY)
@driven
async def test_the_ledger_of_a_session_closes_under_every_fault(faulty: tuple[str, str]) -> None:
    """While it streams, in a query, and when it has ended; each of its counters is needed for that."""
    model, fault = faulty
    with ledgers_made() as ledgers, suppress(DeviceLost):
        async with open_lidar(f"sim://{model}?via=memory{fault}&seed=3") as lidar:
            with suppress(LidarError, TimeoutError):
                async with timeout(5.0), lidar.scans() as stream:
                    async for _ in stream:
                        assert_stats_close(lidar.stats)
                        if lidar.stats.scans == 2:
                            await lidar.get_health()
    assert len(ledgers.sessions) == 1
    ledgers.assert_closed()
    ((assembled, (link,)),) = ledgers.streams
    counted: list[tuple[object, str]] = [
        (link.stats, name) for name in (*BYTES, "unread_packets") if getattr(link.stats, name)
    ]
    counted += [(assembled, name) for name in PACKETS if getattr(assembled, name)]
    assert len(counted) >= 3
    for counters, name in counted:
        right = getattr(counters, name)
        setattr(counters, name, 0)
        with pytest.raises(AssertionError, match="accounted for"):
            ledgers.assert_closed()
        setattr(counters, name, right)
    ledgers.assert_closed()


def test_a_line_of_a_process_takes_nothing_of_what_is_said_behind_it() -> None:
    """A busy machine reads several lines at once: the second one was waited for in vain, and the third was lost."""
    with child("print('one\\ntwo\\nthree', flush=True); input()") as process:
        assert [line_of(process.stdout) for _ in range(2)] == ["one\n", "two\n"]
        assert process.communicate("\n", timeout=PATIENCE_S) == ("three\n", "")


@pytest.mark.long
def test_what_goes_on_for_ever_on_a_driven_loop_fails() -> None:
    """A device that sends, or a timer that comes again, keeps the clock going."""

    async def main() -> None:
        driven_loop().most_turns = 1000
        async with make_rig("rplidar").read() as (_, stream):
            async for _ in stream:
                pass

    with pytest.raises(AssertionError, match=r"gone round 1000 times, \d+ s .*: this would go on for ever"):
        run_driven(main)


@pytest.mark.long
def test_the_suite_watches_every_test(tmp_path: Path) -> None:
    """The conftest of the suite, with tests that leave something behind."""
    conftest = ROOT / "tests" / "conftest.py"
    impatient = "\n\nfrom tests.support import leaks\n\nleaks.GRACE_S = 0.05\n"
    (tmp_path / "conftest.py").write_text(conftest.read_text(encoding="utf-8") + impatient, encoding="utf-8")
    (tmp_path / "test_culprits.py").write_text(CULPRITS, encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(tmp_path),
         "-p", "no:cacheprovider", "-rA", str(tmp_path)],
        cwd=tmp_path, env={**os.environ, **OF_A_DEVELOPER, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    # A test whose fixture fails after it is reported as passed, and as an error.
    told = re.findall(r"^(PASSED|FAILED|ERROR) \S+::(test_\w+)", ended.stdout, re.MULTILINE)
    assert {name for outcome, name in told if outcome != "PASSED"} == CAUGHT, ended.stdout
    assert {name for _, name in told} > CAUGHT


@pytest.mark.long
def test_the_suite_ends_where_one_process_runs_it() -> None:
    """What a test left open is closed then; workers of pytest-xdist are ended without."""
    places = [ROOT / "tests" / name for name in ("network", "ros")]
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "0", *places],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout


@pytest.mark.long
def test_no_test_looks_at_what_is_private() -> None:
    """By an import or a string; attributes are looked for by ruff (SLF001)."""
    named = r'(?:[sg]etattr|patch)\([^)]*"(?:[\w.]*\.)?_[a-z]\w*"'
    private = re.compile(rf"{named}|^ *from lidario.*[. ]_[a-z]", re.MULTILINE)
    found = {path: private.findall(path.read_text("utf-8")) for path in (ROOT / "tests").rglob("*.py")}
    assert {path: names for path, names in found.items() if names} == {}
