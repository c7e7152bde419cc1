"""What is sent under a key, and what any bytes that come from a network are read as."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace

import numpy as np
import pytest
import zenoh
from hypothesis import example, given
from hypothesis import strategies as st

from lidario.basics.model import DeviceInfo, Health, HealthStatus, ScanMode
from lidario.errors import InvalidValue
from lidario.network.keys import Attachment, Token, check_key, parse_attachment, parse_token, token_key
from lidario.network.messages import (
    Entry,
    encode_raw_message,
    encode_scan,
    parse_raw_message,
    parse_scan,
    scan_of_laserscan,
)
from lidario.network.status import Status
from lidario.recording.about import About
from lidario.recording.chronicle import Responded, StreamBegan, StreamEnded
from lidario.scans.laserscan import LaserScan
from lidario.scans.scan import Scan
from tests.scans.test_scan import FOUR
from tests.support.recorded import same_scan
from tests.support.sweep import sweep

OFFSET_NS = 10**18
INFO = DeviceInfo("rplidar", "S2", 0x71, "1.02", 18, "AB12")
MODE = ScanMode(1, "DenseBoost", 31.25, 30.0, 0x85, typical=True)
BEGAN = StreamBegan(7, b"\xa5\x82", MODE, 84, 31250.0, 0.5, 1_000_000, OFFSET_NS, 0.0)
ABOUT = About(INFO, Health(HealthStatus.WARNING, 3), source="sim://x", lidario="1", events=(BEGAN,))
GOOD = replace(FOUR, wall_stamp_ns=FOUR.stamp_ns + OFFSET_NS)


def test_a_scan_arrives_as_it_was_sent() -> None:
    for scan in (GOOD, replace(GOOD, intensities=None), replace(GOOD, rpm=math.nan, mode="é" * 30), none_of(GOOD)):
        again = parse_scan(encode_scan(scan), OFFSET_NS)
        assert again is not None
        assert same_scan(scan, again)
        assert again.reported_rpm == scan.reported_rpm or math.isnan(scan.reported_rpm)


def none_of(scan: Scan) -> Scan:
    return scan.select(np.zeros(len(scan), bool))


def test_a_scan_message_that_was_cut_is_none() -> None:
    whole = encode_scan(GOOD)
    assert all(parse_scan(whole[:length], 0) is None for length in range(len(whole)))


BAD_FIGURES = {
    "an angle of 360": replace(GOOD, device_angles=np.full(len(GOOD), 360, np.float32)),
    "an angle that is none": replace(GOOD, device_angles=np.full(len(GOOD), np.nan, np.float32)),
    "a negative distance": replace(GOOD, device_distances=np.full(len(GOOD), -1, np.float32)),
    "an endless distance": replace(GOOD, device_distances=np.full(len(GOOD), np.inf, np.float32)),
    "a speed below 0": replace(GOOD, rpm=-1.0),
    "a seam behind the circle": replace(GOOD, seam=360.0),
    "a range that is none": replace(GOOD, max_range=math.nan),
    "time that goes back": replace(GOOD, time_increment_ns=-1),
    "a day": replace(GOOD, duration_ns=86_400 * 10**9),
}


@pytest.mark.parametrize("scan", BAD_FIGURES.values(), ids=BAD_FIGURES)
def test_what_no_scan_can_say_makes_it_none(scan: Scan) -> None:
    assert parse_scan(encode_scan(scan), 0) is None


@given(st.binary(max_size=200).map(lambda tail: encode_scan(GOOD)[:72] + tail) | st.binary(max_size=150))
def test_any_bytes_are_a_scan_or_none(data: bytes) -> None:
    scan = parse_scan(data, 0)
    if scan is not None:
        assert 8 * len(scan) < len(data)
        scan.to_laserscan(8)


entries = st.lists(st.builds(Entry, st.booleans(), st.integers(-(2**61), 2**61), st.binary(max_size=9)), max_size=5)


@given(entries)
def test_a_raw_message_arrives_as_it_was_sent(sent: list[Entry]) -> None:
    message = encode_raw_message(sent)
    assert parse_raw_message(message) == sent
    for length in range(len(message)):
        assert parse_raw_message(message[:length]) is None
    assert parse_raw_message(message + b"\0") is None


@example(b"LDR1" + struct.pack("<I", 2**32 - 1))
@example(b"LDR1" + struct.pack("<IBxxxIq", 1, 0, 2**32 - 1, 0))
@given(st.binary(max_size=60).map(lambda data: b"LDR1" + data))
def test_any_bytes_are_a_raw_message_or_none(data: bytes) -> None:
    found = parse_raw_message(data)
    assert found is None or sum(len(each.data) for each in found) < len(data)


# ------------------------------------------------------------------------------------------------ status and keys


def test_a_status_arrives_as_it_was_sent() -> None:
    status = Status("raw", "r7", ABOUT, (MODE,), MODE, 10.0, "unplugged")
    assert Status.of(status.to_bytes(whole=True)) == status
    ended = replace(status, about=replace(ABOUT, events=(StreamEnded(3),)))
    assert Status.of(ended.to_bytes(whole=True)) == ended


def test_what_comes_each_second_has_the_stream_and_no_responses() -> None:
    about = replace(ABOUT, events=(Responded(b"\xa5\x50", 4, b"x"), BEGAN))
    read = Status.of(Status("raw", "r7", about).to_bytes(whole=False))
    assert read is not None
    assert read.about.events == (BEGAN,)


@given(
    st.binary(max_size=40)
    | st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(["form", "about", "modes", "mode", "rate", "robot"]), inner, max_size=6
            )
        ),
        max_leaves=8,
    ).map(lambda value: json.dumps(value).encode())
)
def test_any_bytes_are_a_status_or_none(data: bytes) -> None:
    status = Status.of(data)
    assert status is None or 0 <= status.rate < 1e6


def test_a_status_that_is_too_large_is_none() -> None:
    assert Status.of(b'{"form":"raw","about":{}}') is not None
    assert Status.of(b'{"form":"raw","about":{}}' + b" " * (1 << 18)) is None
    assert Status.of(b"[" * 100_000) is None


@pytest.mark.parametrize("key", ["scan", "robots/r7/scan", "0/scan/sensor_msgs::msg::dds_::LaserScan_/RIHS01_64"])
def test_keys(key: str) -> None:
    assert check_key(key) == key


@pytest.mark.parametrize(
    "key", ["", "/a", "a/", "a//b", "a b", "a#", "a?x", "a/**/*", "a$b", "a\n", "@x/a", "a/@b", "x" * 600]
)
def test_what_is_no_key(key: str) -> None:
    with pytest.raises(InvalidValue):
        check_key(key, wildcards=True)


parts = st.sampled_from(
    ["a", "scan", "*", "**", "***", "@x", "r*", "*r", "$*", "a$*", "", ".", "é", "x y", "#", "::_"]
)


@given(st.lists(parts, max_size=5).map("/".join) | st.text("a/*@$#?_", max_size=8) | st.text(max_size=6))
def test_zenoh_takes_every_key_that_we_take(key: str) -> None:
    try:
        check_key(key, wildcards=True)
    except InvalidValue:
        return
    assert str(zenoh.KeyExpr(key)) == key


def test_wildcards_name_many() -> None:
    assert check_key("robots/*/scan", wildcards=True)
    assert check_key("robots/**", wildcards=True)
    for everywhere in ("**", "*", "*/scan", "**/scan", "*/**"):
        assert check_key(everywhere, wildcards=True) == everywhere
    with pytest.raises(InvalidValue, match="many"):
        check_key("robots/*/scan")
    with pytest.raises(InvalidValue):
        check_key("robots/r*/scan", wildcards=True)


def test_a_token_says_which_lidar_it_is() -> None:
    token = Token("robots/r7/scan", "raw", "r7", "S2", "AB12")
    assert parse_token(token_key(token)) == token
    odd = token_key(Token("a", "scan", "r/7 *#é", "@x", ""))
    assert odd == "a/@lidario/alive/scan/r_7____/_x/-"
    assert parse_token("a/@lidario/alive/other/r/m/s") is None
    assert parse_token("a/b") is None


def test_an_attachment_arrives_as_it_was_sent() -> None:
    sent = Attachment(1, 2**60, bytes(range(16)))
    assert len(sent.to_bytes()) == 33
    assert parse_attachment(sent.to_bytes()) == sent
    assert parse_attachment(sent.to_bytes()[:-1]) is None
    assert parse_attachment(sent.to_bytes()[:16] + b"\x08" + bytes(16)) is None


# ------------------------------------------------------------------------------------------------ LaserScans


@pytest.mark.parametrize("order", ["counter-clockwise", "measured"])
def test_a_laserscan_of_ours_is_the_same_again(order: str) -> None:
    truth = sweep(hertz=10, sample_us=500, gaps=[(0.3, 0.05)])
    laser = truth.scan.to_laserscan(150, order=order)  # type: ignore[arg-type]
    scan = scan_of_laserscan(laser, 3, 0)
    assert scan is not None
    assert scan.seq == 3
    assert scan.rpm == pytest.approx(600, rel=1e-3)
    assert np.all(np.diff(scan.device_angles) > 0)
    again = scan.to_laserscan(150, order=order)  # type: ignore[arg-type]
    known = np.isfinite(laser.ranges)
    np.testing.assert_allclose(again.ranges[known], laser.ranges[known], rtol=1e-6)
    assert not np.any(np.isfinite(again.ranges[~known]))
    assert again.stamp_ns == pytest.approx(laser.stamp_ns, abs=3e5)
    assert again.time_increment == pytest.approx(laser.time_increment, rel=1e-3)


def laserscan(**changes: object) -> LaserScan:
    base = LaserScan(
        10**18, "laser", -1.0, 1.0, 0.5, 0.0, 0.1, 0.1, 8.0,
        np.array([1, 2, np.inf, np.nan, 9], np.float32), np.array([0, 300, -5, np.nan, 7], np.float32),
    )  # fmt: skip
    return replace(base, **changes)  # type: ignore[arg-type]


def test_a_laserscan_of_a_part_of_the_circle() -> None:
    scan = scan_of_laserscan(laserscan(), 0, 0)
    assert scan is not None
    assert scan.device_distances.tolist() == [0, 0, 0, 2000, 1000]
    assert scan.intensities is not None
    assert scan.intensities.tolist() == [7, 0, 0, 255, 0]
    assert math.isnan(scan.rpm)
    assert scan.time_increment_ns == pytest.approx(2e7)
    np.testing.assert_allclose(np.degrees([1, 0.5, 0, -0.5, -1]), scan.angles * 180 / np.pi, atol=1e-4)


def test_a_device_that_turns_the_other_way_keeps_its_order() -> None:
    scan = scan_of_laserscan(laserscan(time_increment=0.01, intensities=np.zeros(0, np.float32)), 0, 0)
    assert scan is not None
    assert scan.ranges[0] == 1
    assert scan.intensities is None
    assert scan.wall_stamp_ns == 10**18


def test_a_range_that_is_the_largest_number_is_no_return() -> None:
    """Some nodes send FLT_MAX where nothing came back. A warning of numpy is an error here."""
    scan = scan_of_laserscan(laserscan(ranges=np.array([1, np.finfo(np.float32).max, 2], np.float32)), 0, 0)
    assert scan is not None
    assert scan.device_distances.tolist() == [2000, 0, 1000]


wild = st.floats(width=32)


@given(st.tuples(*[wild] * 7), st.lists(wild, max_size=5), st.integers(-(2**63), 2**63 - 1))
def test_any_figures_are_a_scan_or_none(figures: tuple[float, ...], ranges: list[float], stamp_ns: int) -> None:
    names = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
    values = np.array(ranges, np.float32)
    changes = {**dict(zip(names, figures, strict=True)), "ranges": values, "intensities": values}
    scan = scan_of_laserscan(laserscan(stamp_ns=stamp_ns, **changes), 0, 0)
    if scan is not None:
        assert np.all((scan.device_angles >= 0) & (scan.device_angles < 360))
        assert np.all(np.isfinite(scan.device_distances))
        assert parse_scan(encode_scan(scan), 0) is not None
