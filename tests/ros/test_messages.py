"""The messages as bytes: byte for byte what an independent encoder writes, and what any bytes are read as."""

import math
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from lidario.basics.model import DeviceInfo, Health, HealthStatus, Stats
from lidario.ros.diagnostics import ERROR, OK, WARN, DiagnosticArray, DiagnosticStatus, diagnostics
from lidario.ros.pointcloud import POINT, PointCloud2, pointcloud2
from lidario.scans.laserscan import LaserScan
from tests.scans.test_scan import FOUR
from tests.support.sweep import check, sweep

STORE = get_typestore(Stores.ROS2_JAZZY)
SEVEN = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
INFO = DeviceInfo("rplidar", "S2", 0x71, "1.02", 18, "AB12")


def read(data: bytes, name: str) -> Any:
    return STORE.deserialize_cdr(data, name)


def header(stamp_ns: int, frame_id: str) -> Any:
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp, frame_id)


def theirs(message: LaserScan | PointCloud2 | DiagnosticArray) -> bytes:
    """What rosbags makes of the same fields."""
    types = STORE.types
    head = header(message.stamp_ns, message.frame_id)
    made: Any
    if isinstance(message, LaserScan):
        name = "sensor_msgs/msg/LaserScan"
        made = types[name](
            head, message.angle_min, message.angle_max, message.angle_increment, message.time_increment,
            message.scan_time, message.range_min, message.range_max, message.ranges, message.intensities,
        )  # fmt: skip
    elif isinstance(message, PointCloud2):
        name = "sensor_msgs/msg/PointCloud2"
        field = types["sensor_msgs/msg/PointField"]
        fields = [field("x", 0, 7, 1), field("y", 4, 7, 1), field("z", 8, 7, 1), field("intensity", 12, 7, 1),
                  field("t", 16, 6, 1)]  # fmt: skip
        data = np.frombuffer(message.points.tobytes(), np.uint8)
        count = len(message.points)
        made = types[name](head, 1, count, fields, False, 20, 20 * count, data, True)
    else:
        name = "diagnostic_msgs/msg/DiagnosticArray"
        pair, status = types["diagnostic_msgs/msg/KeyValue"], types["diagnostic_msgs/msg/DiagnosticStatus"]
        made = types[name](
            head,
            [
                status(each.level, each.name, each.message, each.hardware_id, [pair(*two) for two in each.values])
                for each in message.status
            ],
        )
    return bytes(STORE.serialize_cdr(made, name))


texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
stamps = st.integers(0, (2**31 - 1) * 10**9)
floats = st.floats(width=32)


@given(
    stamp_ns=stamps,
    frame=texts,
    figures=st.tuples(*[floats] * 7),
    ranges=st.lists(floats, max_size=9),
    carried=st.booleans(),
)
def test_a_laserscan_is_the_same_byte_for_byte_and_is_read_again(
    stamp_ns: int, frame: str, figures: tuple[float, ...], ranges: list[float], carried: bool
) -> None:
    values = np.array(ranges, np.float32)
    seven = dict(zip(SEVEN, figures, strict=True))
    message = LaserScan(
        stamp_ns=stamp_ns, frame_id=frame, ranges=values, intensities=values if carried else values[:0], **seven
    )
    assert message.to_cdr() == theirs(message)
    again = LaserScan.from_cdr(message.to_cdr())
    assert again is not None
    assert again.frame_id == frame or not frame.isprintable()
    assert replace(again, frame_id=frame).to_cdr() == message.to_cdr()


@given(
    stamp_ns=stamps, frame=texts, points=st.lists(st.tuples(*[floats] * 4, st.integers(0, 2**32 - 1)), max_size=4)
)
def test_a_point_cloud_is_the_same_byte_for_byte(stamp_ns: int, frame: str, points: list[Any]) -> None:
    message = PointCloud2(stamp_ns, frame, np.array(points, POINT))
    assert message.to_cdr() == theirs(message)


@given(
    stamp_ns=stamps,
    status=st.lists(
        st.builds(
            DiagnosticStatus,
            st.integers(0, 3),
            texts,
            texts,
            texts,
            st.lists(st.tuples(texts, texts), max_size=3).map(tuple),
        ),
        max_size=3,
    ),
)
def test_diagnostics_are_the_same_byte_for_byte(stamp_ns: int, status: list[DiagnosticStatus]) -> None:
    message = DiagnosticArray(stamp_ns, tuple(status))
    assert message.to_cdr() == theirs(message)


def test_the_other_byte_order_is_read() -> None:
    message = FOUR.to_laserscan(8)
    head = struct.pack(">iII", *divmod(message.stamp_ns, 10**9), 6) + b"laser\0"
    figures = struct.pack(">7f", *(getattr(message, name) for name in SEVEN))
    data = b"\0\0\0\0" + head + bytes(-len(head) % 4) + figures
    for values in (message.ranges, message.intensities):
        data += struct.pack(">I", len(values)) + values.astype(">f4").tobytes()
    again = LaserScan.from_cdr(data)
    assert again is not None
    assert again.to_cdr() == message.to_cdr()


WHOLE = FOUR.to_laserscan(8).to_cdr()


def test_a_message_that_was_cut_is_none() -> None:
    assert all(LaserScan.from_cdr(WHOLE[:length]) is None for length in range(len(WHOLE)))


@example(WHOLE[:52] + b"\xff\xff\xff\x7f" + WHOLE[56:])
@example(WHOLE[:12] + b"\xff\xff\xff\xff" + WHOLE[16:])
@given(st.binary(max_size=200).map(lambda data: b"\0\1\0\0" + data) | st.binary(max_size=60))
def test_no_length_is_believed_that_the_bytes_do_not_bear_out(data: bytes) -> None:
    found = LaserScan.from_cdr(data)
    assert found is None or 4 * (len(found.ranges) + len(found.intensities)) < len(data)


def test_what_a_text_cannot_carry_does_not_break_the_message() -> None:
    message = replace(FOUR.to_laserscan(2), frame_id="a\0b\ud800")
    again = read(message.to_cdr(), "sensor_msgs/msg/LaserScan")
    assert again.header.frame_id == "a?b?"
    status = DiagnosticStatus(OK, "a\0b\ud800", "", "")
    array = read(DiagnosticArray(0, (status,)).to_cdr(), "diagnostic_msgs/msg/DiagnosticArray")
    assert array.status[0].name == "a?b?"


def test_points_have_the_place_and_the_time_of_their_samples() -> None:
    truth = sweep(hertz=10, sample_us=500, gaps=[(0.3, 0.1)])
    cloud = pointcloud2(truth.scan, frame_id="front", mount_yaw=math.pi / 2)
    assert len(cloud.points) == len(truth.kept)
    for point, number in zip(cloud.points, truth.kept, strict=True):
        assert math.hypot(point["x"], point["y"]) == pytest.approx(1 + number / 1000, rel=1e-5)
        away = math.degrees(math.atan2(point["y"], point["x"])) - 90 + truth.angle_deg[number]
        assert (away + 180) % 360 - 180 == pytest.approx(0, abs=1e-3)
        assert cloud.stamp_ns + int(point["t"]) == pytest.approx(truth.wall_ns[number], abs=1e6)
    assert cloud.stamp_ns == pytest.approx(truth.scan.wall_stamp_ns, abs=1000)


def test_the_points_of_a_sorted_scan_are_those_of_the_scan() -> None:
    scan = sweep(hertz=10, sample_us=500, gaps=[(0.3, 0.1)]).scan
    for one, other in ((scan.sorted(), scan), (scan.sorted().select(scan.sorted().angles > 0), None)):
        wanted = pointcloud2(scan.select(scan.angles > 0) if other is None else other)
        made = pointcloud2(one)
        assert made.stamp_ns == wanted.stamp_ns
        np.testing.assert_array_equal(made.points, wanted.points)


def test_samples_without_a_return_are_no_points() -> None:
    silent = replace(FOUR, device_distances=np.where(FOUR.device_distances > 1500, 0, FOUR.device_distances))
    cloud = pointcloud2(silent)
    assert len(cloud.points) == np.count_nonzero(silent.device_distances)
    assert len(pointcloud2(silent.select(np.zeros(len(silent), bool))).points) == 0
    with pytest.raises(ValueError, match="mount_yaw"):
        pointcloud2(FOUR, mount_yaw=math.nan)


@pytest.mark.parametrize(
    ("health", "lost", "level", "words"),
    [
        (Health(HealthStatus.OK, 0), "", OK, "OK"),
        (Health(HealthStatus.WARNING, 3), "", WARN, "warning"),
        (Health(HealthStatus.ERROR, 9, "protects itself"), "", ERROR, "protects itself"),
        (Health(HealthStatus.OK, 0), "it was unplugged", ERROR, "it was unplugged"),
    ],
)
def test_health_as_diagnostics(health: Health, lost: str, level: int, words: str) -> None:
    for stats in (Stats(scans=7), Stats(scans=7, overruns=3)):
        (status,) = diagnostics(5, "lidario: scan", INFO, health, stats=stats, rate=10.0, lost=lost).status
        assert (status.level, status.message, status.hardware_id) == (level, words, "AB12")
        told = dict(status.values)
        assert (told["scans"], told["health code"]) == ("7", str(health.code))
        assert told["line"] == (stats.line_trouble or "OK")
    assert told["line"] != "OK"


@pytest.mark.parametrize("order", ["counter-clockwise", "measured"])
def test_the_preset_of_the_vendors_turns_the_angles_and_keeps_the_times(order: Any) -> None:
    truth = sweep(hertz=10, sample_us=500, gaps=[(0.3, 0.1)])
    laser = truth.scan.to_laserscan(200, order=order, preset="vendor")
    check(laser, truth, yaw=math.pi)
    assert min(laser.angle_min, laser.angle_max) == pytest.approx(-math.pi + math.pi / 200)
    # pi minus the device's angle, as those drivers compute it.
    number = int(np.nanargmin(laser.ranges))
    theta = laser.angle_min + number * laser.angle_increment
    assert math.degrees(math.pi - theta) % 360 == pytest.approx(truth.angle_deg[0], abs=360 / 200)
    mounted = truth.scan.to_laserscan(200, order=order, preset="vendor", mount_yaw=-math.pi)
    np.testing.assert_array_equal(mounted.ranges, truth.scan.to_laserscan(200, order=order).ranges)
