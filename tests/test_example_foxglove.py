"""The Foxglove example: a client of its WebSocket protocol, with the reader of protobuf, gets the scans."""

import asyncio
import base64
import json
import math
import signal
import struct
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.asyncio.client import connect

from tests.support.children import BOUND, line_of
from tests.support.example import EXAMPLES, running
from tests.support.walls import WALLS, from_walls, is_all_around, is_at_ten_hertz

PROGRAM = f"""
import foxglove_live, lidario, lidario.testing
lidario.run(foxglove_live.main(lidario.testing.SimulatedLidar(walls={WALLS}), port=0))
"""

AS_STARTED = f"""
import runpy, sys, foxglove
start = foxglove.start_server
foxglove.start_server = lambda port: start(port=0)
sys.argv = ["foxglove_live.py", "sim://rplidar-s2?via=memory"]
runpy.run_path({str(EXAMPLES / "foxglove_live.py")!r}, run_name="__main__")
"""
"""As its user starts it, but at any free port."""


def message_class(channel: dict[str, Any]) -> Any:
    """A class for the messages of a channel, made of the schema that comes with it."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


async def scans_from(address: str, count: int) -> list[tuple[int, Any]]:
    """So many messages of /scan, each with the time of its log."""
    found, made = list[tuple[int, Any]](), None
    async with connect(address, subprotocols=["foxglove.sdk.v1"]) as client:  # type: ignore[list-item]
        while len(found) < count:
            came = await client.recv()
            if isinstance(came, bytes):
                assert made is not None
                kind, subscription, at_ns = struct.unpack_from("<BIQ", came)
                assert (kind, subscription) == (1, 7)
                found.append((at_ns, made.FromString(came[13:])))
            elif (told := json.loads(came))["op"] == "advertise":
                (channel,) = told["channels"]
                assert (channel["topic"], channel["encoding"]) == ("/scan", "protobuf")
                made = message_class(channel)
                asked = {"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}
                await client.send(json.dumps(asked))
    return found


@pytest.mark.long
def test_foxglove_live_reaches_a_client() -> None:
    with running(PROGRAM) as process:
        address = line_of(process.stdout).strip()

        async def main() -> list[tuple[int, Any]]:
            async with asyncio.timeout(BOUND):
                return await scans_from(address, 3)

        found = asyncio.run(main())
    stamps = [scan.timestamp.ToNanoseconds() for _, scan in found]
    assert [at_ns for at_ns, _ in found] == stamps
    assert is_at_ten_hertz(stamps)
    for _, scan in found:
        assert len(scan.ranges) > 3000
        assert scan.end_angle - scan.start_angle == pytest.approx(math.tau, rel=1e-3)
        angles = np.linspace(scan.start_angle, scan.end_angle, len(scan.ranges))
        points = np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.array(scan.ranges)[:, None]
        points = points[np.isfinite(scan.ranges)]
        assert is_all_around(points)
        assert from_walls(points).max() < 0.01


@pytest.mark.long
def test_ctrl_c_is_a_normal_end() -> None:
    with running(AS_STARTED) as process:
        assert line_of(process.stdout).startswith("ws://")
        process.send_signal(signal.SIGINT)
        assert process.wait(BOUND) == 0
