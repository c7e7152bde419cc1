"""Bare bytes whose model must be told from them, or by the user."""

import logging
import struct
from collections.abc import Callable
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidario
from lidario.families.ydlidar.formats import INFO_HEADER, SCAN_HEADER
from lidario.families.ydlidar.simulated.device import make_simulated
from lidario.recording.offline import OfflineDecoder
from tests.cli.processes import invoke
from tests.reference import golden, ldrobot
from tests.support.cases import ALL
from tests.support.recorded import replayed, same_points

STREAMS = {
    "ydlidar_x4_11hz": ("x4", 5000),
    "ydlidar_g6_12hz": ("g6", 8000),
    "ydlidar_g2_11hz": ("g2", 5000),
    "ydlidar_tmini_10hz": ("tmini", 4000),
    "ydlidar_4ros_room10": ("4ros", 20_000),
    "ydlidar_4ros_room7": ("4ros", 20_000),
    "ydlidar_4ros_wrap": ("4ros", 20_000),
}
"""The model whose samples each holds, and its rate."""


def same(scans: list[lidario.Scan], others: list[lidario.Scan]) -> None:
    assert len(scans) == len(others) > 0
    for scan, other in zip(scans, others, strict=True):
        assert same_points(scan, other)
        assert (scan.stamp_ns, scan.lost_packets) == (other.stamp_ns, other.lost_packets)


def without_speed(name: str) -> bytes:
    """The stream with CT = 01 in its start packets, as real X4s have it."""
    case = next(case for case in ALL if case.name == name)
    changed = []
    for packet in case.split(case.raw):
        if packet[2] & 1:
            check = packet[8] ^ packet[2] ^ 1
            packet = packet[:2] + b"\x01" + packet[3:8] + bytes((check,)) + packet[9:]
        changed.append(packet)
    assert case.split(b"".join(changed)) == changed
    return b"".join(changed)


@pytest.mark.parametrize("name", STREAMS)
def test_rate_and_speed_tell_the_model(name: str, caplog: pytest.LogCaptureFixture) -> None:
    raw, (model, rate) = golden.load(name).raw, STREAMS[name]
    with caplog.at_level(logging.WARNING, "lidario"):
        guessed = list(lidario.decode(raw, family="ydlidar"))
    assert "which YDLIDAR sent these bytes is a guess: " in caplog.text
    assert f"model={model}" in caplog.text
    caplog.clear()
    named = list(lidario.decode(raw, model=model.upper()))
    assert caplog.text == ""
    same(guessed, named)
    assert OfflineDecoder(raw).stream.mode.sample_us == pytest.approx(1e6 / rate)


@pytest.mark.parametrize("name", ["ydlidar_x4_11hz", "ydlidar_g2_11hz", "ydlidar_tmini_10hz"])
def test_without_a_told_speed_the_samples_of_a_revolution_tell_it(name: str) -> None:
    raw, (model, _) = without_speed(name), STREAMS[name]
    same(list(lidario.decode(raw)), list(lidario.decode(raw, model="x4" if model == "x4" else "tmini")))


def test_a_rate_that_can_be_set_follows_from_the_told_speed() -> None:
    for model in ("tg15", "tg50"):
        scans = list(lidario.decode(golden.load("ydlidar_tg15_12hz").raw, model=model))
        assert scans[2].rpm == pytest.approx(scans[2].reported_rpm, rel=0.02)
    guessed = list(lidario.decode(golden.load("ydlidar_tg15_12hz").raw))
    assert guessed[2].rpm == pytest.approx(guessed[2].reported_rpm, rel=0.02)


def heard_of(name: str) -> bytes:
    """What a simulated device that only talks sends in a second."""
    device = make_simulated(name, seed=3)
    device.set_dtr(True, 0)
    return b"".join(device.transmit(at) for at in range(0, 1_000_000_000, 50_000_000))


@pytest.mark.parametrize(
    ("name", "code", "guess"),
    [
        ("ydlidar-x3", 6, "X2"),
        ("ydlidar-s2-pro", 4, "S2 Pro"),
        ("ydlidar-tx8", 100, "TX8"),
        ("ydlidar-x3", 77, "X2"),
    ],
)
def test_one_that_only_talks_is_not_taken_for_one_of_the_same_code(
    name: str, code: int, guess: str, caplog: pytest.LogCaptureFixture
) -> None:
    """They tell their code when they get power (X2 manual, 3)."""
    told = INFO_HEADER + bytes((code, 10, 1, 1)) + bytes(16)
    with caplog.at_level(logging.WARNING, "lidario"):
        scans = list(lidario.decode(told + heard_of(name)))
    assert f"which YDLIDAR sent these bytes is a guess: {guess}, " in caplog.text
    assert scans[1].rpm == pytest.approx(360, rel=0.01)


@pytest.mark.parametrize("header", [b"", SCAN_HEADER])
def test_one_that_announces_its_stream_is_what_it_told(header: bytes, caplog: pytest.LogCaptureFixture) -> None:
    """A real X4 told this (a driver for the STM32); without the header it may as well be an X4 Pro."""
    told = bytes.fromhex("A55A1400000004 060A0101 02000200000602010000000002010500")
    with caplog.at_level(logging.WARNING, "lidario"):
        scans = list(lidario.decode(told + header + without_speed("ydlidar_x4_11hz")))
    assert bool(caplog.text) is not bool(header)
    same(scans, list(lidario.decode(without_speed("ydlidar_x4_11hz"), model="x4")))


@pytest.mark.parametrize(
    "name", ["ldrobot_ld19_6hz", "ldrobot_ld19_13hz", "ldrobot_stl27l_13hz", "ldrobot_ld14p_6hz"]
)
@pytest.mark.exhaustive("gone", sample=[(3, 4), (5, 17), (1, 22), tuple(range(1, 24, 2))])
def test_packets_that_are_missing_make_no_other_model(name: str, gone: tuple[int, ...]) -> None:
    packets = ldrobot.split(golden.load(name).raw)
    whole = OfflineDecoder(b"".join(packets))
    found = OfflineDecoder(b"".join(packet for number, packet in enumerate(packets) if number not in gone))
    assert found.title == whole.title
    assert found.stream.format.response_type == whole.stream.format.response_type
    assert found.stream.sample_ns == pytest.approx(whole.stream.sample_ns, rel=0.01)


def test_an_ld08_and_an_ld14_are_not_told_apart(caplog: pytest.LogCaptureFixture) -> None:
    raw = golden.load("ldrobot_ld08_5hz").raw
    with caplog.at_level(logging.WARNING, "lidario"):
        guessed = list(lidario.decode(raw))
    assert "name the model, as in ?model=ld08, or ?model=ld14" in caplog.text
    same(guessed, list(lidario.decode(raw, model="ld14")))
    named = list(lidario.decode(raw, model="ld08"))
    seen = named[1].device_distances > 0
    # ROBOTIS's own figures: 6 mm more at 0.12 m, 60 mm more at 8 m.
    assert (named[1].device_distances - guessed[1].device_distances)[seen].min() > 5


def test_a_last_sample_behind_the_seam_belongs_to_the_turn_it_ends() -> None:
    """As of a real T-mini Plus, whose start packets stood at 0.25 and then at 0.72 degrees, and it at 0.27."""
    case = next(case for case in ALL if case.name == "ydlidar_tmini_10hz")
    packets = case.split(case.raw)
    starts = [number for number, packet in enumerate(packets) if packet[2] & 1]
    words = (0x55AA, 0x0100, 17 << 1 | 1, 17 << 1 | 1, 70, 4000 << 2)
    check = reduce(xor, words)
    last = struct.pack("<5HBH", *words[:4], check, *words[4:])
    packets.insert(starts[4], last)
    before = list(lidario.decode(case.raw, model="tmini"))
    scans = list(lidario.decode(b"".join(packets), model="tmini"))
    assert [len(scan) for scan in scans] == [len(scan) + (number == 3) for number, scan in enumerate(before)]
    assert (scans[3].device_angles[-1], scans[3].device_distances[-1]) == (17 / 64, 4000)
    assert all(not scan.lost_packets for scan in scans)


def by_function(path: Path, **known: Any) -> list[lidario.Scan]:
    return list(lidario.decode_file(path, **known))


def by_source(path: Path, **known: Any) -> list[lidario.Scan]:
    return replayed(path, "&".join(["rate=0", *(f"{name}={value}" for name, value in known.items())]))


@pytest.mark.parametrize("read", [by_function, by_source])
def test_wherever_bytes_are_named(read: Callable[..., list[lidario.Scan]], tmp_path: Path) -> None:
    path = tmp_path / "x4.bin"
    path.write_bytes(golden.load("ydlidar_x4_11hz").raw)
    scans = read(path, model="g6", sample_us=100)
    right = read(path, model="x4")
    assert scans[2].stamp_ns - scans[1].stamp_ns == pytest.approx(
        (right[2].stamp_ns - right[1].stamp_ns) / 2, rel=0.01
    )
    assert scans[1].device_distances.max() == pytest.approx(2 * right[1].device_distances.max())


def test_the_verbs(tmp_path: Path) -> None:
    path = tmp_path / "x4.bin"
    path.write_bytes(golden.load("ydlidar_x4_11hz").raw)
    told = invoke("info", str(path))
    assert "YDLIDAR X4 (a guess)" in told.stdout
    named = invoke("info", f"{path}?model=g4")
    assert "YDLIDAR G4 " in named.stdout
    assert "guess" not in named.stdout
    for model in ("x4", "g6"):
        assert invoke("export", str(path), str(tmp_path / f"{model}.npz"), "--model", model).exit_code == 0
    with np.load(tmp_path / "x4.npz") as x4, np.load(tmp_path / "g6.npz") as g6:
        near = {name: np.max(arrays["device_distances"]) for name, arrays in (("x4", x4), ("g6", g6))}
    assert near["g6"] == pytest.approx(2 * near["x4"])
    refused = invoke("export", str(path), str(tmp_path / "no.npz"), "--model", "x5")
    assert refused.exit_code in (2, 3)
    assert "there is no model 'x5'" in refused.stderr
    with pytest.raises(lidario.RecordingError, match="of the model 'ld06'"):
        list(lidario.decode_file(path, model="ld06"))
