"""The DDS example: another process, which declares the messages by itself, receives the scans."""

import json
import signal

import numpy as np
import pytest

from tests.support.children import line_of
from tests.support.example import running
from tests.support.walls import WALLS, from_walls, is_all_around, is_at_ten_hertz

DOMAIN = 137
LOOPBACK = """<CycloneDDS><Domain>
<General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
"""Nobody else hears this, and nothing of it leaves the machine."""
WRITER = f"""
import dds_publish, lidario, lidario.testing
lidario.run(dds_publish.main(lidario.testing.SimulatedLidar(walls={WALLS}), domain_id={DOMAIN}))
"""
AS_STARTED = """
import runpy, sys
sys.argv[1:] = ["sim://rplidar-s2"]
runpy.run_module("dds_publish", run_name="__main__")
"""
READER = f"""
import json
from dataclasses import dataclass
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, int32, sequence, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32

@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str

@dataclass
class Scan(IdlStruct, typename="sensor_msgs.msg.dds_.LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]

node = DomainParticipant({DOMAIN})
reader = DataReader(node, Topic(node, "rt/scan", Scan))
for scan in reader.take_iter(timeout=duration(seconds=60)):
    stamp = scan.header.stamp.sec * 10**9 + scan.header.stamp.nanosec
    told = [stamp, scan.header.frame_id, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max]
    print(json.dumps([*told, list(scan.ranges)]), flush=True)
"""


@pytest.mark.long
def test_dds_publish_reaches_another_process() -> None:
    with running(WRITER, CYCLONEDDS_URI=LOOPBACK), running(READER, CYCLONEDDS_URI=LOOPBACK) as reader:
        found = [json.loads(line_of(reader.stdout)) for _ in range(3)]
    for _, frame, angle_min, increment, nearest, farthest, ranges in found:
        assert (frame, round(nearest, 6)) == ("laser", 0.05)
        assert len(ranges) > 3000
        angles, distances = angle_min + increment * np.arange(len(ranges)), np.array(ranges)
        returned = (distances >= nearest) & (distances <= farthest)
        points = (np.stack([np.cos(angles), np.sin(angles)]) * distances).T[returned]
        assert is_all_around(points)
        assert from_walls(points).max() < 0.01
    assert is_at_ten_hertz([scan[0] for scan in found])


@pytest.mark.long
def test_ctrl_c_is_a_normal_end() -> None:
    reading = READER.replace(f"DomainParticipant({DOMAIN})", "DomainParticipant(0)")
    with running(AS_STARTED, CYCLONEDDS_URI=LOOPBACK) as writer:
        with running(reading, CYCLONEDDS_URI=LOOPBACK) as reader:
            line_of(reader.stdout)
        writer.send_signal(signal.SIGINT)
        assert writer.wait(30.0) == 0
