"""The fault table: no fault makes lidario hang, crash or be silent, and a driver that does is found out."""

from typing import Any, NamedTuple

import pytest

from benchmarks import faults
from benchmarks.fault_peers import Told, verdict
from benchmarks.faults import FAILURES, ROWS, Outcome, judge
from benchmarks.models import SUFFERERS
from benchmarks.report import Setting
from lidario.revolution.seam import Seam
from lidario.session.streaming import running
from lidario.sim.faults import FAULTS

pytestmark = pytest.mark.discards("the device boots, is frozen or has no power")
FIRST_ROWS = list({row.partition(":")[0]: row for row in reversed(ROWS)}.values())
MODELS = list(SUFFERERS)
EVERY_FAULT = [(MODELS[number % len(MODELS)], row) for number, row in enumerate(FIRST_ROWS)]
"""Every fault, at its lowest rate, on one of the devices in turns."""
EVERY_PLACE = [(model, row) for model in MODELS[:2] for row in ROWS] + [
    (model, row) for number, model in enumerate(MODELS[2:]) for row in FIRST_ROWS[number % 3 :: 3]
]
"""Every row on two devices, every third one on each of the rest, so that each fault is on two or three of them:
`make faults` prints them all."""


class Bounds(NamedTuple):
    """What a device may lose: least scans, packets until one is recognised, packets beyond the damage, points;
    how much is told, and how many turns of a reboot."""

    scans: int = 45
    recovered: int = 3
    beyond: int = 2
    wrong: float = 0.002
    told: float = 0.9
    missed: int = 5


BOUNDS = {
    # Five bytes with two check bits.
    "rplidar-a1": Bounds(scans=20, recovered=6, beyond=300, wrong=0.02, told=0.0),
    # A capsule between two bytes of noise cannot be told from noise, and it sends one every 8 ms.
    "rplidar-c1": Bounds(beyond=720),
    # Some of the damage is done before anybody listens.
    "ldrobot-ld06": Bounds(told=0.8),
    # It takes two seconds to know that it only talks, and some of the damage is done before. A start packet that
    # came twice makes a revolution of it.
    "ydlidar-x2": Bounds(scans=35, beyond=20, told=0.5),
    # DTR switches its motor: each start takes half a second more.
    "ydlidar-x4": Bounds(scans=45),
    "ydlidar-g2": Bounds(told=0.7),
    "ydlidar-tmini": Bounds(told=0.7),
    # A piece of the line that comes twice holds two or three of its packets: the angle seems to go back.
    "neato-xv11": Bounds(scans=43, beyond=500, missed=3),
    # What follows a reboot is not the first turn that a seam begins.
    "camsense-x1": Bounds(beyond=60, told=0.8, missed=3),
    "irobotix-delta2a": Bounds(told=0.8, missed=3),
    "hlds-lds01": Bounds(scans=42, beyond=130, told=0.7, missed=2),
    # One packet of 2134 bytes is a whole scan.
    "hokuyo-urg04lx": Bounds(scans=14, told=0.8),
}
ONLY_TALK = ("ldrobot-ld06", "ydlidar-x2", "neato-xv11", "camsense-x1", "irobotix-delta2a")
FEWEST = {
    # The 4ROS has no pause that a thousand random bytes a second would leave whole.
    "babble:1000": 20,
    # With 300 ms for each response, it takes 9 s to ask an S2 for its modes and the limits of its speed, until each
    # response has come twice alike; an A1 has five modes.
    "late:300ms": 1,
}
"""Scans that must come, in the same time, whatever the device."""
NO_SCAN_IS_WHOLE = [("hokuyo-urg04lx", row) for row in ("drop:1%", "flip:1%")]
"""Of 2134 bytes, and responses of a few hundred, one in a hundred is damaged."""
SCANS = [(1.0 + 0.1 * number, 3200, 0) for number in range(80)]


def test_every_fault_is_in_the_table() -> None:
    assert {row.partition(":")[0] for row in ROWS} == set(FAULTS)


@pytest.mark.long
@pytest.mark.exhaustive("where", sample=EVERY_FAULT, full=EVERY_PLACE)
def test_no_fault_makes_it_hang_or_crash_or_be_silent(where: tuple[str, str]) -> None:
    model, row = where
    found = judge(model, row)
    assert not found.outcome.startswith(FAILURES), found
    bounds, fault = BOUNDS.get(model, Bounds()), row.partition(":")[0]
    if found.outcome == "goes on":
        assert found.scans >= FEWEST.get(row, bounds.scans)
        # Where the descriptor was lost, the packets until the next start are no stream.
        unannounced = found.told.get("stray_bytes", 0) > 10_000
        assert unannounced or found.recovered <= bounds.recovered
        if fault in ("reboot", "protect"):
            assert found.told["missed_scans"] >= bounds.missed
        elif row not in ("babble:1000", "flip:1%", "drop:1%"):
            assert found.beyond <= bounds.beyond
        assert found.wrong < bounds.wrong
        assert unannounced or found.told.get("lost_packets", 0) >= bounds.told * found.damaged
    elif fault == "protect":
        # Of those that only talk, nobody but the one who cuts the power can restart the motor.
        assert model in ONLY_TALK
    elif fault not in ("garbage", "freeze", "babble") and (model, row) not in NO_SCAN_IS_WHOLE:
        assert found.again.startswith("scans after")


@pytest.mark.long
def test_damage_that_no_counter_tells_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faults, "TELLING", ("broken_scans",))
    assert judge("ydlidar-4ros", "drop:0.01%").outcome == "silent: goes on"


@pytest.mark.long
def test_a_watchdog_that_sleeps_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    for patience in ("SILENCE_S", "REVOLUTIONS_MISSED"):
        monkeypatch.setattr(running, patience, 1e6)
    assert judge("rplidar-s2", "silent:3s").outcome == "hangs"


def test_a_foreign_exception_is_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    def blunder(*_: object) -> list[object]:
        raise IndexError("a bug")

    monkeypatch.setattr(Seam, "splits", blunder)
    assert judge("rplidar-s2", "late:300ms").outcome.startswith("crashes")


def test_the_table_is_printed_and_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        faults, "judge", lambda model, row: Outcome("goes on", 90, 10, 1, 2, 0.1, {"lost_packets": 3})
    )
    result = faults.run(Setting(quick=False))
    assert [table.title for table in result.tables] == [f"faults: lidario, {each}" for each in SUFFERERS]
    assert result.tables[0].rows[0] == [
        "drop:0.01%", "goes on", "2 packets", "2 of 10", "10.000 %", "lost_packets 3", "–",
    ]  # fmt: skip
    assert result.data["rplidar-s2"]["unplug:3s"]["damaged"] == 10


@pytest.mark.parametrize(
    ("told", "row", "says"),
    [
        (Told(SCANS, {}), "drop:1%", "goes on"),
        (Told(SCANS[:20], {}), "silent:3s", "hangs: no scan and no error for the last 6.1 s"),
        (Told([], {}), "garbage", "hangs: no scan, no error"),
        (Told(SCANS[::2], {}), "drop:1%", "silent: 50 % missing"),
        (Told([(at, 3200, 32) for at, _, _ in SCANS], {}), "flip:1%", "silent: 1.00 % wrong"),
        (Told([], {}, "ended with -11, said nothing"), "flip:1%", "crashes: ended with -11, said nothing"),
    ],
)
def test_what_a_user_gets_in_words(told: Told, row: str, says: str) -> None:
    assert verdict(told, row, usual=32_000.0) == says


@pytest.mark.parametrize(
    ("ended", "says"),
    [
        ({"error": "RPLidarException", "module": "rplidar"}, "RPLidarException after 0.5 s"),
        ({"error": "SerialException", "module": "serial.serialutil"}, "SerialException after 0.5 s"),
        ({"error": "IndexError", "module": "builtins"}, "crashes: IndexError after 0.5 s"),
        (
            {"error": "_Refused", "module": "__main__", "text": "connect() returned False"},
            "connect() returned False after 0.5 s",
        ),
    ],
)
def test_which_exceptions_a_user_can_expect(ended: dict[str, Any], says: str) -> None:
    assert verdict(Told(SCANS, {"text": "", "at_s": 3.5} | ended), "unplug:3s", usual=32_000.0) == says
