"""lidario: an asyncio driver for 2D laser scanners.

::

    async with lidario.open_lidar() as lidar:
        async for scan in lidar.scans():
            print(scan.nearest())

A public name is loaded when it is first used: programs that only ask for the version, or complete a command line,
do not wait for numpy and asyncio.
"""

from typing import TYPE_CHECKING

from lidario.loading import keep, load
from lidario.version import __version__

if TYPE_CHECKING:
    from lidario import conformance as conformance
    from lidario import errors as errors
    from lidario import filters as filters
    from lidario import ros as ros
    from lidario import testing as testing
    from lidario.basics.model import DeviceInfo, Health, HealthStatus, NetworkAddress, SampleRate, ScanMode, Stats
    from lidario.config.read import Config, LidarConfig, read_config
    from lidario.config.write import save_config
    from lidario.errors import (
        Busy,
        CannotRecord,
        ConnectFailed,
        ConnectReason,
        DeviceFault,
        DeviceLost,
        InternalError,
        InvalidValue,
        LidarError,
        LocalProtocolError,
        ProtocolError,
        RecordingError,
        RemoteProtocolError,
        ResponseTimeout,
        SessionClosed,
        StreamFailed,
        Unsupported,
    )
    from lidario.port.line import Tap
    from lidario.port.simulation import simulate
    from lidario.recording.decode_file import RecordingSummary, decode_file, decode_file_arrays, summarize
    from lidario.recording.offline import ScanArrays, decode, decode_arrays
    from lidario.recording.record import Recording
    from lidario.scans.beams import BeamOrder, NoReturn, Preset
    from lidario.scans.laserscan import LaserScan
    from lidario.scans.laserscans import LaserScans
    from lidario.scans.measured import Return
    from lidario.scans.merging import Merged
    from lidario.scans.points import Motion, Mount, Points, PoseFunction, Velocity, merge
    from lidario.scans.registration import Registration, looseness, register
    from lidario.scans.scan import Scan
    from lidario.scans.sector import Sector
    from lidario.session.finding.discovery import Found, PortInfo, list_lidars, list_serial_ports
    from lidario.session.finding.reconnect import Reconnect
    from lidario.session.lidar import Lidar
    from lidario.session.merged import MergedStream, merged
    from lidario.session.opening import OpenLidar, open_lidar
    from lidario.session.run import run
    from lidario.session.streaming.line_changes import LineChange, LineChanges
    from lidario.session.streaming.stream import ScanStream, SectorStream
    from lidario.sim.device import Received, SimulatedDevice
    from lidario.sim.world import Wall, WorldLike
    from lidario.sync.lidar import SyncLidar, open_sync
    from lidario.sync.streams import SyncLineChanges, SyncRecording, SyncScanStream, SyncSectorStream

__all__ = [
    "BeamOrder", "Busy", "CannotRecord", "Config", "ConnectFailed", "ConnectReason", "DeviceFault",
    "DeviceInfo", "DeviceLost", "Found", "Health", "HealthStatus", "InternalError", "InvalidValue", "LaserScan",
    "LaserScans", "Lidar", "LidarConfig", "LidarError", "LineChange", "LineChanges", "LocalProtocolError",
    "Merged", "MergedStream", "Motion", "Mount", "NetworkAddress", "NoReturn", "OpenLidar", "Points",
    "PortInfo", "PoseFunction", "Preset", "ProtocolError", "Received", "Reconnect", "Recording",
    "RecordingError", "RecordingSummary", "Registration", "RemoteProtocolError", "ResponseTimeout", "Return",
    "SampleRate", "Scan", "ScanArrays", "ScanMode", "ScanStream", "Sector", "SectorStream", "SessionClosed",
    "SimulatedDevice", "Stats", "StreamFailed", "SyncLidar", "SyncLineChanges", "SyncRecording",
    "SyncScanStream", "SyncSectorStream", "Tap", "Unsupported", "Velocity", "Wall", "WorldLike", "__version__",
    "decode", "decode_arrays", "decode_file", "decode_file_arrays", "list_lidars", "list_serial_ports",
    "looseness", "merge", "merged", "open_lidar", "open_sync", "read_config", "register", "run", "save_config",
    "simulate", "summarize",
]  # fmt: skip

_HOMES = {
    "errors": (
        "Busy", "CannotRecord", "ConnectFailed", "ConnectReason", "DeviceFault", "DeviceLost", "InternalError",
        "InvalidValue", "LidarError", "LocalProtocolError", "ProtocolError", "RecordingError",
        "RemoteProtocolError", "ResponseTimeout", "SessionClosed", "StreamFailed", "Unsupported",
    ),
    "sync.lidar": ("SyncLidar", "open_sync"),
    "config.read": ("Config", "LidarConfig", "read_config"),
    "config.write": ("save_config",),
    "recording.decode_file": ("RecordingSummary", "decode_file", "decode_file_arrays", "summarize"),
    "recording.record": ("Recording",),
    "session.finding.discovery": ("Found", "PortInfo", "list_lidars", "list_serial_ports"),
    "scans.beams": ("BeamOrder", "NoReturn", "Preset"),
    "scans.laserscan": ("LaserScan",),
    "scans.laserscans": ("LaserScans",),
    "basics.model": ("DeviceInfo", "Health", "HealthStatus", "NetworkAddress", "SampleRate", "ScanMode", "Stats"),
    "sync.streams": ("SyncLineChanges", "SyncRecording", "SyncScanStream", "SyncSectorStream"),
    "scans.measured": ("Return",),
    "scans.merging": ("Merged",),
    "scans.registration": ("Registration", "looseness", "register"),
    "session.merged": ("MergedStream", "merged"),
    "scans.scan": ("Scan",),
    "scans.sector": ("Sector",),
    "scans.points": ("Motion", "Mount", "Points", "PoseFunction", "Velocity", "merge"),
    "port.line": ("Tap",),
    "recording.offline": ("ScanArrays", "decode", "decode_arrays"),
    "session.lidar": ("Lidar",),
    "session.streaming.line_changes": ("LineChange", "LineChanges"),
    "session.opening": ("OpenLidar", "open_lidar"),
    "session.finding.reconnect": ("Reconnect",),
    "session.run": ("run",),
    "session.streaming.stream": ("ScanStream", "SectorStream"),
    "sim.device": ("Received", "SimulatedDevice"),
    "sim.world": ("Wall", "WorldLike"),
    "port.simulation": ("simulate",),
}  # fmt: skip
"""Module -> the public names that live in it."""


_ROOMS = ("conformance", "errors", "filters", "ros", "testing")
"""What programs import from. ``lidario.filters`` is also found after ``import lidario`` alone."""


def __getattr__(name: str) -> object:
    return load(f"{__name__}.{name}") if name in _ROOMS else keep(__name__, name, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
