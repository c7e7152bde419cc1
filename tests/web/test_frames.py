"""The bytes that the page reads say what the scan says."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.typing import NDArray

from lidario import DeviceInfo, Mount, Scan, Stats
from lidario.web.feed import Feed
from lidario.web.frames import HEADER, pack_scan, pack_state
from lidario.web.traffic import traffic


def scan(
    degrees: list[float], millimetres: list[float], intensities: list[int] | None = None, **more: object
) -> Scan:
    usual: dict[str, object] = {
        "stamp_ns": 0, "wall_stamp_ns": 1_700_000_000_123_000_000, "time_increment_ns": 0,
        "duration_ns": 100_000_000, "rpm": 600.0, "seq": 7, "dropped_before": 0, "lost_packets": 2,
        "mode": "Standard",
    }  # fmt: skip
    return Scan(
        np.array(degrees, np.float32),
        np.array(millimetres, np.float32),
        None if intensities is None else np.array(intensities, np.uint8),
        **{**usual, **more},  # type: ignore[arg-type]
    )


def read(data: bytes) -> tuple[tuple[object, ...], NDArray[np.float64], NDArray[np.uint16], bytes]:
    """The header, the angles in degrees counter-clockwise, the ranges, the rest."""
    head = HEADER.unpack_from(data)
    count = int(head[3])
    angles = np.frombuffer(data, "<u2", count, 32) * (360 / 65536)
    return head, angles, np.frombuffer(data, "<u2", count, 32 + 2 * count), data[32 + 4 * count :]


def test_every_value_is_where_the_page_looks_for_it() -> None:
    head, angles, ranges, rest = read(
        pack_scan(3, scan([0, 90, 270, 359.99], [0, 1234.4, 65535, 70000], [1, 2, 3, 255]))
    )
    assert head == (1, 3, 1, 4, 1_700_000_000_223.0, 7, 10.0, 2, 0)
    assert angles == pytest.approx([0, 270, 90, 0.01], abs=360 / 65536)
    assert ranges.tolist() == [0, 1234, 65535, 65535]
    assert rest == bytes([1, 2, 3, 255])


def test_every_angle_comes_back_within_a_step() -> None:
    degrees = np.random.default_rng(1).uniform(0, 360, 5000).astype(np.float32)
    degrees[:2] = (0.0, np.nextafter(np.float32(360), np.float32(0)))
    _, angles, _, _ = read(pack_scan(0, scan(degrees.tolist(), [1000.0] * 5000)))
    assert np.abs((angles + degrees + 180) % 360 - 180).max() <= 360 / 65536


def test_states_are_json_for_any_text() -> None:
    # A file name that is not UTF-8 stands there as Python has it.
    feed = Feed("fl\udcfcr.mcap", mount=Mount(1, 2, np.pi / 2), colour="#112233")
    feed.info = DeviceInfo("f", "</script>\u2028", 1, "1", 1, '"')
    feed.state, feed.reason = "lost", "x" * 10_000
    feed.line = traffic(Stats(), Stats(packets=97, lost_packets=3, bytes_received=100), 1.0, 2000)
    told = json.loads(pack_state([feed, Feed("b")], 12.5).encode())
    assert told["echo"] == 12.5
    first, second = told["lidars"]
    assert first["source"] == feed.source
    assert (first["model"], first["state"], first["damaged"], first["load"]) == (
        "</script>\u2028",
        "lost",
        0.03,
        0.5,
    )
    assert (first["x"], first["y"], first["yaw"], first["colour"]) == (1, 2, 90, "#112233")
    assert len(first["reason"]) == 200
    assert (second["state"], second["damaged"], second["model"]) == ("connecting", None, "")
