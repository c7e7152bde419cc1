"""Every call and every buffer has a bound: the tables of ``docs/bounds.md``, in driven time."""

import asyncio
import inspect
import os
import re
import signal
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from itertools import count, product
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from lidario import Lidar, LidarError, ResponseTimeout, run
from lidario.basics.model import LineErrors
from lidario.families.rplidar.formats import DenseFormat
from lidario.port.inbox import Late
from lidario.port.port import Port
from lidario.port.turns import TURN_NS
from lidario.session.talking.intake import Intake
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from tests.support.devices import FAMILIES, Rig, babble, call, make_rig
from tests.support.links import PACKETS
from tests.support.loop import DrivenLoop, now, run_driven
from tests.support.times import takes

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "bounds.md").read_text(encoding="utf-8")


def rows_of(columns: str) -> dict[str, list[float]]:
    """The rows of the table of calls that has these columns."""
    table = re.search(rf"^\| call \| {columns} \|.*\n.*\n((?:\|.*\n)+)", TEXT, re.MULTILINE)
    assert table is not None
    rows = re.findall(r"^\| `(\w+)`(?: of a stream)? ((?:\| [\d.]+ )+)\|", table[1], re.MULTILINE)
    return {call: [float(each) for each in figures.split("|")[1:]] for call, figures in rows}


def in_turns(rows: Iterable[str], families: Sequence[str]) -> list[tuple[str, str]]:
    """Every call once, with the families in turns."""
    return [(name, families[row % len(families)]) for row, name in enumerate(rows)]


BOUNDS = {call: dict(zip(FAMILIES, row, strict=True)) for call, row in rows_of(r"RPLIDAR \| 4ROS").items()}
OTHERS = ("ldrobot", "neato", "camsense", "irobotix", "hokuyo", "hlds")
OF_OTHERS = {call: dict(zip(OTHERS, row, strict=True)) for call, row in rows_of("LDROBOT .* HLDS").items()}


def harm(rig: Rig, how: str) -> None:
    """Have the device fall silent, or send noise for ever."""
    if how == "silent":
        rig.device.mute = True
    else:
        babble(rig.device)


async def seconds(rig: Rig, name: str, how: str, *, scanning: bool) -> float:
    """How long the call takes."""
    if name == "open_lidar":
        harm(rig, how)
        began = now()
        with suppress(LidarError):
            await rig.open()
        return now() - began
    async with rig.open() as lidar:
        stream = lidar.scans()
        if scanning or name in ("anext", "aclose"):
            await anext(stream)
        harm(rig, how)
        began = now()
        with suppress(LidarError):
            if name == "anext":
                while True:
                    began = now()
                    await anext(stream)
            elif name == "aclose":
                await stream.aclose()
            else:
                await call(lidar, name)
        return now() - began


SAMPLE = [
    *in_turns(BOUNDS, FAMILIES),
    *(("open_lidar", family) for family in OTHERS),
    *in_turns(OF_OTHERS, OTHERS[::-1]),
    # How long it boots is said by each.
    *(("reset", family) for family in (*FAMILIES, "hokuyo")),
]


@pytest.mark.exhaustive(
    "what", sample=list(dict.fromkeys(SAMPLE)), full=[*product(BOUNDS, FAMILIES), *product(OF_OTHERS, OTHERS)]
)
def test_no_call_takes_longer_than_the_table_says(what: tuple[str, str]) -> None:
    name, family = what
    bound = (BOUNDS if family in FAMILIES else OF_OTHERS)[name][family]
    taken = [
        run_driven(partial(seconds, make_rig(family), name, how, scanning=scanning))
        for how in ("silent", "noise")
        for scanning in (False, True)
    ]
    # The table is no guess: what it says is nearly reached, but for what takes no time at all.
    assert 0.75 * bound - 0.2 <= max(taken) <= bound, taken


@pytest.mark.long
async def test_a_device_that_begins_no_stream_is_given_up(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    said = re.search(r"begins no stream,[^.]*\s([\d.]+) s then", TEXT)
    assert said is not None
    bound = float(said[1])
    transmit = rig.device.transmit
    monkeypatch.setattr(rig.device, "transmit", lambda at: b"" if rig.device.scanning else transmit(at))
    async with rig.open() as lidar:
        with takes(bound, more_than_s=bound / 2), pytest.raises(ResponseTimeout):
            await lidar.scan()
        assert (await lidar.get_health()).ok


def test_the_table_has_every_call() -> None:
    public = {
        name
        for name in dir(Lidar)
        if not name.startswith("_") and inspect.iscoroutinefunction(getattr(Lidar, name))
    }
    assert public | {"open_lidar", "anext", "aclose"} == set(BOUNDS)


def test_each_row_names_a_test() -> None:
    """But for the tables of calls and verbs, which a test reads as a whole."""
    tables = re.findall(r"^\|[^\n]*\| test \|\n\|[-|]+\|\n((?:\|.*\n)+)", TEXT, re.MULTILINE)
    rows = [row for table in tables for row in table.splitlines()]
    assert len(rows) > 25
    assert [row for row in rows if not re.search(r"`tests/[\w/]+\.py::\w+`", row)] == []


def test_run_ends_as_soon_as_its_sessions_are_closed(rplidar: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a signal, also with a device that has fallen silent."""
    monkeypatch.setattr("asyncio.events.new_event_loop", DrivenLoop)
    times: list[float] = []

    async def main() -> None:
        try:
            async with rplidar.read():
                harm(rplidar, "silent")
                times.append(now())
                os.kill(os.getpid(), signal.SIGTERM)
                await asyncio.sleep(3600)
        finally:
            times.append(now())

    with pytest.raises(SystemExit) as ended:
        run(main())
    assert ended.value.code == 128 + signal.SIGTERM
    assert times[1] - times[0] <= BOUNDS["close"]["rplidar"]


def test_early_packets_are_bounded() -> None:
    intake = intake_on(lambda: 0)
    run = Packets(b"\0", (Block(1, 1),), ((1, 0),))
    # As docs/bounds.md says; each run counts as what it takes beside its bytes, too.
    most = 256 * 1024 // 512
    for _ in range(2 * most):
        assert list(intake.deliver(run)) == []
    got: list[Packets] = []

    def take(packets: Packets) -> list[None]:
        got.append(packets)
        return []

    intake.deliver_to(take)
    assert len(got) + intake.stats.unread_packets == 2 * most
    assert len(got) == -(-256 * 1024 // (512 + 1))


class Taken(Intake):
    """What is received is parsed and handed on, and nothing else becomes of it."""

    def responded(self, payload: bytes) -> None:
        """Nobody asks."""

    def taken(self) -> None:
        """Nobody waits."""

    def mistaken(self, error: Exception) -> None:
        raise error


def intake_on(clock: Callable[[], int], late: Late | None = None) -> Taken:
    """A stream runs."""
    port = SimpleNamespace(now=clock, is_real_time=False, errors=LineErrors(), late=late or Late())
    intake = Taken(cast("Port", port))
    intake.link.enter_stream(DenseFormat())
    return intake


def slow_intake() -> Taken:
    """Each step of its work takes all the time of a turn of the loop."""
    times = count(0, TURN_NS)
    intake = intake_on(lambda: next(times))
    intake.deliver_to(lambda packets: iter([None] * packets.count))
    return intake


async def test_reads_that_found_the_buffer_of_the_system_full_are_counted() -> None:
    """By the port, which may have counted some before."""
    late, told = Late(full_reads=2), list[int]()
    intake = intake_on(lambda: 0, late)
    for late.full_reads in (2, 3, 3, 5):
        intake.data_received(b"", 0)
        told.append(intake.stats.late_reads)
    assert told == [0, 1, 1, 3]


async def test_much_that_comes_together_is_parsed_in_steps() -> None:
    intake, packets = slow_intake(), b"".join(PACKETS[:10])
    intake.data_received(packets * 100, 0)
    assert 0 < intake.stats.bytes_received <= 8192
    intake.data_received(packets, 0)
    while intake.stats.bytes_received < 101 * len(packets):
        before = intake.stats.bytes_received
        await asyncio.sleep(0)
        assert intake.stats.bytes_received - before <= 8192
    assert intake.stats.packets == 1010


async def test_what_waits_to_be_parsed_is_bounded() -> None:
    intake, packets = slow_intake(), b"".join(PACKETS[:10])
    # The first is parsed at once, and what becomes of its packets takes long.
    for _ in range(1000):
        intake.data_received(packets, 0)
    # As docs/bounds.md says; each counts as what it takes beside its bytes, too.
    waits = (1 << 20) // (10 * 84 + 512)
    assert intake.stats.discarded_bytes == (1000 - waits) * 10 * 84


async def test_a_device_that_claims_many_modes(rplidar: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    conf = type(rplidar.device.profile).conf
    asked: list[int] = []

    def claims(profile: object, kind: int, arguments: bytes) -> bytes | None:
        if kind == 0x70:
            return b"\xff\xff"
        asked.append(int.from_bytes(arguments[:2], "little"))
        told: bytes | None = conf(profile, kind, b"\1\0" if arguments else b"")
        return told

    monkeypatch.setattr(type(rplidar.device.profile), "conf", claims)
    async with rplidar.open() as lidar:
        assert len(await lidar.get_modes()) == 64
    assert max(asked) == 63
