"""Each of the other drivers opened and read as its own documentation shows: a generator of samples per revolution.

Where a driver delivers single samples, revolutions are cut at its own new-scan flag, or where the angle wraps.
Nothing is done with the samples beyond counting them, as nothing is done with lidario's.

What had to be helped: a pseudo-terminal has no DTR and RTS lines, and five drivers take its refusal for the
end; here it is ignored. The type hints of `adafruit_rplidar` want two names that only exist on its boards. `lds2d`
sends its stop and its scan request to the second family within a fraction of the 5 ms in which that device hears
nothing, so its model that sends neither is taken, and the request is sent here. `PyLidar3` delivers pieces of 6000
bytes rather than revolutions, and is counted as it delivers.
"""

from __future__ import annotations

import asyncio
import builtins
import contextlib
import logging
import time
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any

import serial

Points = Iterator[int]


def _forgiving(name: str) -> None:
    """Let a line be set that a pseudo-terminal does not have."""
    really = getattr(serial.Serial, name)

    def attempt(port: Any) -> None:
        with contextlib.suppress(OSError):
            really(port)

    setattr(serial.Serial, name, attempt)


if hasattr(serial.Serial, "_update_dtr_state"):
    _forgiving("_update_dtr_state")
    _forgiving("_update_rts_state")


def pyrplidar(port: str, baudrate: int, mode: int) -> Points:
    from pyrplidar import PyRPlidar

    lidar = PyRPlidar()
    lidar.connect(port=port, baudrate=baudrate, timeout=3)
    measurements = lidar.start_scan_express(mode) if mode else lidar.start_scan()
    return _flagged((1, each.start_flag) for each in measurements())


def rplidar_roboticia(port: str, baudrate: int, mode: int, **buffered: Any) -> Points:
    from rplidar import RPLidar

    lidar = RPLidar(port, baudrate=baudrate, timeout=3)
    kind = "express" if mode else "normal"
    return (len(scan) for scan in lidar.iter_scans(kind, **buffered))


def rplidar(port: str, baudrate: int, mode: int, **buffered: Any) -> Points:
    from rplidar import RPLidar

    _plain_only(mode)
    return (len(scan) for scan in RPLidar(port, baudrate=baudrate, timeout=3).iter_scans(**buffered))


def adafruit(port: str, baudrate: int, mode: int, **buffered: Any) -> Points:
    for name in ("UART", "DigitalInOut"):
        setattr(builtins, name, object)
    from adafruit_rplidar import RPLidar

    _plain_only(mode)
    return (len(scan) for scan in RPLidar(None, port, baudrate=baudrate, timeout=3).iter_scans(**buffered))


def lds2d(port: str, baudrate: int, mode: int) -> Points:
    from lds2d import Lidar

    _plain_only(mode)
    return (len(scan) for scan in Lidar.open("RPLIDAR-C1", port, baudrate).scans())


def lds2d_ydlidar(port: str, baudrate: int, mode: int) -> Points:
    from lds2d import Lidar
    from lds2d.transport import SerialTransport

    _plain_only(mode)
    transport = SerialTransport(port, baudrate)
    # The model that has plain millimetres, as the 4ROS; it sends no scan request of its own.
    lidar = Lidar.open("YDLIDAR-TMINI", transport=transport)
    transport.write(b"\xa5\x60")
    return (len(scan) for scan in lidar.scans())


def pylidar3(port: str, baudrate: int, mode: int) -> Points:  # noqa: ARG001 - its own baud rate is built in
    from PyLidar3 import YdLidarX4

    _plain_only(mode)
    lidar = YdLidarX4(port)
    if not lidar.Connect():
        raise RuntimeError("Connect() returned False")
    return (len(means) for means in lidar.StartScanning())


def pyrplidarsdk(port: str, baudrate: int, mode: int) -> Points:  # noqa: ARG001 - takes the recommended mode
    from pyrplidarsdk import RplidarDriver

    driver = RplidarDriver(port=port, baudrate=baudrate)
    if not driver.connect():
        raise RuntimeError("connect() returned False")
    if not driver.start_scan():
        raise RuntimeError("start_scan() returned False")

    def scans() -> Points:
        while True:
            scan = driver.get_scan_data()
            if scan is None:
                time.sleep(0.001)
            else:
                yield len(scan[0])

    return scans()


async def rplidarc1(port: str, baudrate: int, mode: int) -> AsyncIterator[int]:
    from rplidarc1 import RPLidar

    _plain_only(mode)
    logging.disable(logging.WARNING)
    lidar = RPLidar(port, baudrate)
    reading = asyncio.ensure_future(lidar.simple_scan())
    reading.add_done_callback(lambda _: lidar.output_queue.put_nowait(None))
    count, last = 0, 0.0
    try:
        while (point := await lidar.output_queue.get()) is not None:
            if point["a_deg"] < last - 180.0:
                yield count
                count = 0
            last = point["a_deg"]
            count += 1
    finally:
        reading.cancel()


def _flagged(samples: Iterator[tuple[int, bool]]) -> Points:
    count = 0
    for number, begins in samples:
        if begins and count:
            yield count
            count = 0
        count += number


def _plain_only(mode: int) -> None:
    if mode:
        raise RuntimeError("reads only the plain mode")


DRIVERS: dict[str, Callable[..., Points]] = {
    "pyrplidar": pyrplidar,
    "rplidar-roboticia": rplidar_roboticia,
    "rplidar": rplidar,
    "adafruit-circuitpython-rplidar": adafruit,
    "lds2d": lds2d,
    "lds2d-4ros": lds2d_ydlidar,
    "PyLidar3": pylidar3,
    "pyrplidarsdk": pyrplidarsdk,
}

ASYNC: dict[str, Callable[..., AsyncIterator[int]]] = {"rplidarc1": rplidarc1}
