"""Another driver on a damaged line, as a process of its own: which points its user gets, and what ends it.

A thread reads; the main thread tells what there is when the time is up, also when the reader hangs.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import benchmarks.adapters.drivers  # noqa: F401 - makes pyserial open a pseudo-terminal
from benchmarks.adapters.process import respond

_WAIT_S = 0.05

Distances = Iterator[list[float]]
"""The distances of one scan after the other, in millimetres; 0 where nothing came back."""


def _pyrplidar(port: str, baudrate: int, model: str) -> Distances:  # noqa: ARG001
    from pyrplidar import PyRPlidar

    lidar = PyRPlidar()
    lidar.connect(port=port, baudrate=baudrate, timeout=3)
    scan: list[float] = []
    for each in lidar.start_scan()():
        if each.start_flag and scan:
            yield scan
            scan = []
        scan.append(each.distance)


def _roboticia(port: str, baudrate: int, model: str) -> Distances:  # noqa: ARG001
    from rplidar import RPLidar

    for scan in RPLidar(port, baudrate=baudrate, timeout=3).iter_scans("normal"):
        yield [distance for _, _, distance in scan]


def _sdk(port: str, baudrate: int, model: str) -> Distances:  # noqa: ARG001
    from pyrplidarsdk import RplidarDriver

    driver = RplidarDriver(port=port, baudrate=baudrate)
    for step in (driver.connect, driver.start_scan):
        if not step():
            raise _Refused(f"{step.__name__}() returned False")
    while True:
        scan = driver.get_scan_data()
        if scan is None:
            time.sleep(0.002)
        else:
            yield [1000.0 * metres for metres in scan[1]]


def _lds2d(port: str, baudrate: int, model: str) -> Distances:
    from lds2d import Lidar
    from lds2d.transport import SerialTransport

    transport = SerialTransport(port, baudrate)
    lidar = Lidar.open(_NAMES[model], transport=transport)
    if model in ("ydlidar-4ros", "ydlidar-x4"):
        transport.write(b"\xa5\x60")
    for scan in lidar.scans():
        yield [point.dist_mm for point in scan.points]


_NAMES = {
    "ydlidar-4ros": "YDLIDAR-TMINI",
    # Its X4 sends stop and scan in the 5 ms in which the device hears nothing; its X2 reads the same samples.
    "ydlidar-x4": "YDLIDAR-X2",
    "ydlidar-x2": "YDLIDAR-X2",
    "ldrobot-ld06": "LDROBOT-LD06",
}


class _Refused(Exception):
    """The driver says by its result that it could not do it."""


_READERS = {"pyrplidar": _pyrplidar, "rplidar-roboticia": _roboticia, "pyrplidarsdk": _sdk, "lds2d": _lds2d}


def main(task: dict[str, Any]) -> dict[str, Any]:
    """Read for ``seconds``, or until an exception; each scan as time, points and wrong points."""
    began = time.monotonic()
    scans: list[tuple[float, int, int]] = []
    ended: dict[str, Any] = {}
    radius, tolerance = task["radius_mm"], task["tolerance_mm"]

    def read() -> None:
        try:
            for distances in _READERS[task["contestant"]](task["path"], task["baudrate"], task["model"]):
                there = [each for each in distances if each > 0]
                wrong = sum(abs(each - radius) > tolerance for each in there)
                scans.append((time.monotonic() - began, len(there), wrong))
            raise _Refused("the scans ended without an error")
        except BaseException as error:
            kind = type(error)
            ended.update(error=kind.__name__, module=kind.__module__, text=str(error)[:200])
            ended["at_s"] = time.monotonic() - began

    threading.Thread(target=read, daemon=True).start()
    while not ended and time.monotonic() - began < task["seconds"]:
        time.sleep(_WAIT_S)
    return {"scans": list(scans), "ended": dict(ended)}


if __name__ == "__main__":
    respond(main)
