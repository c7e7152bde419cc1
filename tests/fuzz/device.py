"""A device that means harm: it speaks as a real one does, until the bytes of the fuzzer say otherwise.

A session opens it and uses it as a program would, in driven time. What leaves the device, delivery by delivery,
is changed as the bytes say: dropped, repeated, replaced, preceded or followed by bytes of the fuzzer's own, or
flooded.

Promised: the session ends by itself; whatever goes wrong is a `LidarError` and no `InternalError`; texts from the
device can be shown on a terminal; what is kept is bounded; every byte is counted; no task is left.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable
from typing import Any

import lidario
from benchmarks.relayed import Relayed
from tests.fuzz.checks import check_error, check_scan, check_text
from tests.support.ledger import assert_stats_close
from tests.support.loop import run_driven

_FAMILIES = {
    "rplidar": "rplidar-s2",
    "ydlidar": "ydlidar-4ros",
    "hokuyo": "hokuyo-ust10lx",
    "ldrobot": "ldrobot-ld14p",
    "neato": "neato-xv11",
    "camsense": "camsense-x1",
    "irobotix": "irobotix-delta2a",
    "hlds": "hlds-lds01",
}
"""A device of each family."""
_PATIENCE_S = 100.0
_MOST_BUFFERED = 64 * 1024
_FLOOD = 20_000
_SCANS = 4

_CHANGES = [
    bytes(4),
    bytes((1,)) + bytes(8),
    bytes((0, 2, 20)) + b"\xa5\x5a\x14\0\0\0\x04" + bytes(range(20)),
    bytes((1, 3, 27)) + b"\xa5\x5a\x14\0\0\0\x04" + bytes(20),
    bytes((0, 0, 0, 2, 10)) + b"\xa5\x5a\x03\0\0\0\x06\x02\xff\xff",
    bytes((0,)) + bytes((0,) * 5) + bytes((2, 15)) + b"\xa5\x5a\x0e\0\0\0\x20\x7f\0\0\0\x1b[2J",
    bytes((0, 5, 5, 5, 5)),
    bytes((1, 4, 1, 4, 1, 6, 6, 6)),
]
"""The family, and what becomes of each delivery."""
SEEDS = [
    *(seed[:1] + bytes((honest,)) + seed[1:] for honest in (0, 14, 40) for seed in _CHANGES),
    *(bytes((family, 14)) + _CHANGES[family % len(_CHANGES)][1:] for family in range(2, len(_FAMILIES))),
]
"""With so many deliveries unchanged before."""


class _Hostile(Relayed):
    """A simulated device whose deliveries are changed; obeys `lidario.sim.device.SimulatedDevice`."""

    def __init__(self, device: Any, data: bytes) -> None:
        # Coarse while it scans: fewer deliveries, each of which can be changed.
        super().__init__(device, step_ns=20_000_000)
        # So many deliveries are left as they are: otherwise few devices would come as far as a scan.
        self._honest, self._data = (data[0] if data else 0), data[1:]
        self._at = 0
        self._before = b""

    def transmit(self, now: int) -> bytes:
        data: bytes = self.device.transmit(now)
        if data and self._honest:
            self._honest -= 1
            return data
        return self._changed(data) if data else data

    def _changed(self, data: bytes) -> bytes:
        what = self._take(1)
        if not what:
            return data
        match what[0] % 8:
            case 1:
                data = b""
            case 2:
                data = self._own()
            case 3:
                data += self._own()
            case 4:
                data = self._before + data
            case 5:
                data = (self._own() or b"\xa5\x5a") * (_FLOOD // 16)
            case 6:
                data = data[: len(data) // 2]
            case 7:
                place = int.from_bytes(self._take(2), "little") % len(data)
                data = data[:place] + self._take(1) + data[place + 1 :]
        self._before = data[:1024]
        return data[: 2 * _FLOOD]

    def _own(self) -> bytes:
        size = self._take(1)
        return self._take(size[0]) if size else b""

    def _take(self, count: int) -> bytes:
        taken = self._data[self._at : self._at + count]
        self._at += count
        return taken


def hostile_device(data: bytes) -> None:
    """Use a device that behaves as the bytes say; the first chooses the family."""
    family = list(_FAMILIES)[(data[0] if data else 0) % len(_FAMILIES)]
    logging.getLogger("lidario").setLevel(logging.CRITICAL + 1)
    try:
        run_driven(lambda: _use(family, data[1:]))
    finally:
        logging.getLogger("lidario").setLevel(logging.NOTSET)


async def _use(family: str, data: bytes) -> None:
    device: Any = lidario.simulate(_FAMILIES[family], world="circle", spin_up=0)
    limit = asyncio.timeout(_PATIENCE_S)
    try:
        async with limit, lidario.open_lidar(_Hostile(device, data), family=family) as lidar:
            for call in (lidar.get_modes, lidar.get_info, lidar.scan, lidar.get_health, lidar.stop):
                await _tried(call())
                stats = lidar.stats
                assert_stats_close(stats)
                assert stats.buffered <= _MOST_BUFFERED
                _check_texts(lidar)
            await _tried(_read(lidar))
            for mode in await _tried(lidar.get_modes()) or ():
                check_text(mode.name)
    except lidario.LidarError as error:
        check_error(error)
    except TimeoutError:
        assert not limit.expired(), f"it is still busy after {_PATIENCE_S:g} s"
        raise


async def _read(lidar: lidario.Lidar) -> None:
    """A few scans, with a question in their midst."""
    async with lidar.scans() as scans:
        for number in range(_SCANS):
            check_scan(await anext(scans))
            assert lidar.stats.buffered <= _MOST_BUFFERED
            if number == 1:
                await _tried(lidar.get_health())


async def _tried(call: Awaitable[Any]) -> Any:
    try:
        return await call
    except lidario.LidarError as error:
        check_error(error)
        return None


def _check_texts(lidar: lidario.Lidar) -> None:
    info = lidar.info
    for text in (info.model, info.firmware, info.serial, lidar.health.note, repr(lidar)):
        check_text(text)
