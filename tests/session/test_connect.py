"""Finding out what is at the other end: probing on real pseudo-terminals, and what is told when none responds."""

import asyncio
from typing import Any

import pytest

from lidario import ConnectFailed, Lidar, list_lidars, open_lidar
from lidario.basics.model import LineErrors
from lidario.basics.source import as_source
from lidario.families.camsense.simulated import pack_packet as pack_camsense
from lidario.families.registry import FAMILIES
from lidario.families.rplidar.simulated.packers import pack_dense
from lidario.port.port import Port
from lidario.port.simulated import connect_in_memory
from lidario.scans.scan import Scan
from lidario.session.finding.connect import connect
from lidario.session.finding.listening import ReceivedInSilence
from lidario.sim.serve import PtyServer
from tests.support.devices import make_rig
from tests.support.refused import refused
from tests.support.speeds import plugged_in
from tests.support.terminals import WaitingPtyServer
from tests.support.times import takes

PATIENCE_S = 60.0


@pytest.mark.long
@pytest.mark.real_time
async def test_both_families_are_found_and_stream_side_by_side(soak: float) -> None:
    first, second = make_rig("rplidar"), make_rig("ydlidar")
    with WaitingPtyServer(first.device, chunk=64) as one, WaitingPtyServer(second.device, chunk=64) as two:
        found = await list_lidars((one.path, two.path))
        assert [each.info.family for each in found if each.info] == ["rplidar", "ydlidar"]
        assert [each.baudrate for each in found] == [1_000_000, 512_000]
        async with open_lidar(one.path) as left, open_lidar(two.path) as right:
            assert left.info.model == "RPLIDAR S2M1"
            assert right.info.model == "YDLIDAR 4ROS"

            async def watch(lidar: Lidar, turn_s: float) -> None:
                last: Scan | None = None
                async with asyncio.timeout(soak + PATIENCE_S), lidar.scans(depth=8) as stream:
                    async for scan in stream:
                        assert scan.lost_packets == 0
                        # A busy machine may keep this loop from running; what that costs is counted. It may
                        # keep the devices from sending, too: where that lasts, revolutions count as missing.
                        assert last is None or scan.seq > last.seq + scan.dropped_before
                        last = scan
                        if scan.seq >= soak / turn_s:
                            break
                stats = lidar.stats
                assert stats.skipped_bytes == stats.stray_bytes == stats.lost_packets == 0

            await asyncio.gather(watch(left, first.turn_s), watch(right, second.turn_s))
        assert one.lost == two.lost == 0


@pytest.mark.long
@pytest.mark.real_time
@pytest.mark.parametrize("model", ["ldrobot-ld14", "ldrobot-ld08"])
async def test_the_speed_of_a_pseudo_terminal_tells_no_model(model: str) -> None:
    """That of a real line tells a slow LD14P from these two, which hear nothing."""
    with PtyServer(make_rig(model).device) as server:
        async with open_lidar(server.path, family="ldrobot") as lidar:
            assert (lidar.info.model, lidar.can_be_stopped) == ("LDROBOT LD14 or LD08", False)


async def test_auto_takes_the_only_lidar_that_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    lidar, silent = make_rig("ydlidar").device, make_rig("rplidar").device
    silent.mute = True
    plugged_in(monkeypatch, lidar=lidar, silent=silent)
    async with open_lidar() as found:
        assert found.info.family == "ydlidar"
        serial = found.info.serial
    async with open_lidar(f"id:{serial}") as found:
        assert found.info.serial == serial
    with refused("missing", "nothing came back"):
        await open_lidar("id:0000")


async def test_auto_does_not_choose_among_several(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged_in(monkeypatch, one=make_rig("rplidar", seed=1).device, two=make_rig("rplidar", seed=2).device)
    with refused("ambiguous", r"2 lidars respond(.|\n)*S2M1"):
        await open_lidar("auto")


async def test_auto_does_not_write_to_strange_adapters(monkeypatch: pytest.MonkeyPatch) -> None:
    written = plugged_in(monkeypatch, "", somebodys=make_rig("rplidar").device)
    with refused("missing", "somebodys"):
        await open_lidar("auto")
    assert written == []


NOTHING, ALL = "nothing came back", "1000000, 512000, 230400, 115200, 256000, 128000, 460800 or 153600"
IN_VAIN: list[tuple[bytes, str, str, dict[str, Any], str]] = [
    (b"", NOTHING, "/dev/babbler", {}, ALL),
    (bytes(40), "nearly all zero", "/dev/babbler", {}, ALL),
    (bytes(range(7, 200, 3)), "garbage", "/dev/babbler", {}, ALL),
    (pack_dense(100, [500] * 40) * 6, "RPLIDAR packets among them", "/dev/babbler", {}, ALL),
    # What is named, by either way, is all that is asked.
    (b"", NOTHING, "/dev/babbler", {"baudrate": 256_000}, "256000"),
    (b"", NOTHING, "serial:///dev/babbler?baud=256000", {}, "256000"),
    (b"", NOTHING, "/dev/babbler", {"family": "neato"}, "115200"),
    (b"", NOTHING, "serial:///dev/babbler?family=neato", {}, "115200"),
]
"""What the device sends after every request, what is said of it, what is opened, and at which speeds."""


@pytest.mark.parametrize(("babble", "verdict", "source", "named", "speeds"), IN_VAIN)
async def test_what_came_back_is_said(
    babble: bytes, verdict: str, source: str, named: dict[str, Any], speeds: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, due = make_rig("rplidar").device, list[bytes]()
    device.receive = lambda data, now: due.append(babble)
    device.transmit = lambda now: due.pop() if due else b""
    device.wakeup = lambda now: now if due else None

    async def open_babbler(path: str, _: int) -> Port:
        return connect_in_memory(device, name=path)

    monkeypatch.setattr("lidario.session.finding.connect.open_serial", open_babbler)
    with refused("silent", verdict) as caught:
        await open_lidar(source, **named)
    assert f" at {speeds} baud" in str(caught.value)
    assert "powered" in str(caught.value)


def test_the_received_is_bounded() -> None:
    """Only the first 4096 bytes are looked at, which are zero here."""
    received = ReceivedInSilence()
    for number in range(1000):
        received.see("in", bytes([min(number, 1)]) * 4096, 0)
        received.see("out", b"ours", 0)
    assert received.describe(LineErrors()).startswith("4096000 bytes came back, nearly all zero")


BOOT = b"Piccolo Laser Distance Scanner\r\nAll Rights Reserved\r\n\r\nLoader\tV2.4.13386\r\nCPU\tF2802x/c600\r\n"
GARBAGE = bytes(range(1, 200))
TEXT = (
    "bytes came back, text among them: 'Piccolo Laser Distance Scanner'. Is that a lidar? One that says so again "
    "and again restarts: is its supply too weak (5 V, 1.5 A)?"
)
UNMEASURED = "Camsense packets among them, which measure nothing. Does its motor turn, and at the right speed?"


IN_SILENCE: list[tuple[str, tuple[int, ...], bytes, str]] = [
    ("udp://127.0.0.1:8089", (), GARBAGE, "199 bytes of garbage came back, as from no lidar. Is the"),
    ("/dev/ttyUSB0", (), GARBAGE, "199 bytes of garbage came back, as at a wrong baud rate. Is the"),
    ("/dev/ttyUSB0", (115200, 256000), GARBAGE, "of garbage came back, as at a wrong baud rate. Is the"),
    # What the driver has counted says something of one speed alone.
    ("/dev/ttyUSB0", (115200,), GARBAGE, "of garbage came back, with 3 framing errors: the baud rate"),
    ("/dev/ttyUSB0", (115200, 115200), GARBAGE, "of garbage came back, with 3 framing errors: the baud rate"),
    # An XV-11 whose supply was too weak said this again and again (rohbotics/xv_11_laser_driver #6).
    *(("/dev/ttyUSB0", (115200,), before + BOOT * 3, TEXT) for before in (b"", bytes(range(128, 256)) * 8)),
    # Until its rotor turns, the start of a packet is its end (more_families_2.md 4.1).
    *(
        ("/dev/ttyUSB0", (115200,), pack_camsense(start, start, [0.0] * 8, [0] * 8, rpm=30.0) * 5, UNMEASURED)
        for start in (0, 0xA000)
    ),
]
"""What is opened, the speeds that were tried, what came, and what is said of it."""


def test_what_came_in_silence_is_explained() -> None:
    for source, speeds, came, says in IN_SILENCE:
        heard = ReceivedInSilence()
        heard.see("in", came, 0)
        assert says in str(heard.nothing_responds(as_source(source), FAMILIES, speeds, LineErrors(framing=3)))


@pytest.mark.parametrize(("family", "shortly", "patiently"), [("rplidar", 1.5, 7.0), ("ydlidar", 5.0, 7.0)])
async def test_a_known_one_that_does_not_respond_is_given_up_soon_where_nobody_is_patient(
    family: str, shortly: float, patiently: float
) -> None:
    rig = make_rig(family)
    rig.device.mute = True
    for patient, most_s in ((False, shortly), (True, patiently)):
        with takes(most_s), pytest.raises(ConnectFailed, match="nothing responds"):
            await connect(as_source(rig.device), family, patient=patient)
