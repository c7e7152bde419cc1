"""A soak repeats itself exactly, and an invariant that is broken on purpose is caught."""

import asyncio

import pytest

from benchmarks.soak import life
from benchmarks.soak.__main__ import live
from benchmarks.soak.line import DAMAGES
from benchmarks.soak.watch import Broken
from lidario.session.lidar import Lidar
from lidario.session.talking.stopper import Stopper
from lidario.sim.faults import FAULTS
from tests.support import ledger

SECONDS = 45.0
pytestmark = [
    pytest.mark.discards("on a damaged line, and where the invariant is broken on purpose"),
    pytest.mark.usefixtures("quick_collection"),
]


@pytest.mark.long
@pytest.mark.parametrize("family", life.MODELS)
def test_a_seed_always_means_the_same(family: str) -> None:
    first, second = (live(family, 7, 0, SECONDS, CALM) for _ in range(2))
    assert first == second
    assert first.sessions > 3
    assert first.digest != live(family, 8, 0, SECONDS, CALM).digest


def test_every_fault_is_among_the_damages() -> None:
    assert {each.partition(":")[0] for each in DAMAGES} == set(FAULTS)


@pytest.mark.long
def test_a_device_that_is_not_left_still_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Stopper, "requests", lambda self: ())
    with pytest.raises(Broken, match=r"goes on|it scans"):
        live("rplidar", 7, 0, SECONDS, CALM)


def test_a_counter_that_is_wrong_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ledger, "BYTES", tuple(name for name in ledger.BYTES if name != "response_bytes"))
    with pytest.raises(Broken, match="accounted for"):
        live("rplidar", 7, 0, SECONDS, CALM)


def test_a_request_that_comes_too_early_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.families.rplidar.simulated.device.SETTLE_AFTER_STOP", 100_000_000)
    with pytest.raises(Broken, match=r"discarded|healthy device"):
        live("rplidar", 7, 0, SECONDS, CALM)


def test_a_task_that_is_left_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    close = Lidar.close

    async def leave_one(lidar: Lidar) -> None:
        await close(lidar)
        asyncio.get_running_loop().create_task(asyncio.sleep(5.0), name="the culprit")

    monkeypatch.setattr(Lidar, "close", leave_one)
    with pytest.raises(Broken, match=r"left behind.*the culprit"):
        live("ydlidar", 7, 0, SECONDS, CALM)


def test_a_session_that_is_kept_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    kept, close = list[Lidar](), Lidar.close

    async def keep(lidar: Lidar) -> None:
        kept.append(lidar)
        await close(lidar)

    monkeypatch.setattr(Lidar, "close", keep)
    with pytest.raises(Broken, match="kept alive"):
        live("rplidar", 7, 0, SECONDS, CALM)


CALM = ()
"""What a soak still finds mistakes with; see `docs/reliability.md`."""
