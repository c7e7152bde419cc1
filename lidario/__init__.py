"""lidario: an asyncio driver for 2D laser scanners.

::

    async with lidario.open_lidar() as lidar:
        async for scan in lidar.scans():
            print(scan.ranges.min())
"""

from __future__ import annotations

from lidario.discovery import Found, PortInfo, list_lidars, list_serial_ports
from lidario.errors import (
    Busy,
    ConnectFailed,
    DeviceFault,
    DeviceLost,
    LidarError,
    LocalProtocolError,
    ProtocolError,
    RemoteProtocolError,
    ResponseTimeout,
    SessionClosed,
    Unsupported,
)
from lidario.laserscan import LaserScan
from lidario.model import DeviceInfo, Health, HealthStatus, SampleRate, Scan, ScanMode, Stats
from lidario.session import Lidar, open_lidar
from lidario.stream import ScanStream

__version__ = "0.1.0"

__all__ = [
    "Busy",
    "ConnectFailed",
    "DeviceFault",
    "DeviceInfo",
    "DeviceLost",
    "Found",
    "Health",
    "HealthStatus",
    "LaserScan",
    "Lidar",
    "LidarError",
    "LocalProtocolError",
    "PortInfo",
    "ProtocolError",
    "RemoteProtocolError",
    "ResponseTimeout",
    "SampleRate",
    "Scan",
    "ScanMode",
    "ScanStream",
    "SessionClosed",
    "Stats",
    "Unsupported",
    "__version__",
    "list_lidars",
    "list_serial_ports",
    "open_lidar",
]
