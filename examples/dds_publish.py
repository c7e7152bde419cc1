"""Scans as the topic /scan of ROS 2 over DDS, without ROS: pip install cyclonedds."""

import sys
from contextlib import suppress
from dataclasses import make_dataclass

from cyclonedds import domain, idl, pub, topic
from cyclonedds.idl.types import float32, int32, sequence, uint32

import lidario

NUMBERS = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")


def message(name: str, **fields: object) -> type:
    """A message of ROS 2, by the name that it has in DDS."""
    return make_dataclass("Message", fields.items(), bases=(idl.IdlStruct,), namespace={"__idl_typename__": name})


Time = message("builtin_interfaces.msg.dds_.Time_", sec=int32, nanosec=uint32)
Header = message("std_msgs.msg.dds_.Header_", stamp=Time, frame_id=str)
FIELDS = dict.fromkeys(NUMBERS, float32) | {"ranges": sequence[float32], "intensities": sequence[float32]}
LaserScan = message("sensor_msgs.msg.dds_.LaserScan_", header=Header, **FIELDS)


async def main(source: str | lidario.SimulatedDevice = "auto", *, domain_id: int = 0) -> None:
    """Publish every scan until cancelled; the domain is what nodes have as ROS_DOMAIN_ID."""
    node = domain.DomainParticipant(domain_id)
    writer = pub.DataWriter(node, topic.Topic(node, "rt/scan", LaserScan))
    async with lidario.open_lidar(source, reconnect=True) as lidar:
        async for laser in (scan.to_laserscan() async for scan in lidar.scans()):
            header = Header(Time(*divmod(laser.stamp_ns, 10**9)), laser.frame_id)
            numbers = [getattr(laser, name) for name in NUMBERS]
            writer.write(LaserScan(header, *numbers, laser.ranges.tolist(), laser.intensities.tolist()))


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        lidario.run(main(*sys.argv[1:2]))
