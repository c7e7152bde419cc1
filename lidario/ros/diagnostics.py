"""The health of a lidar as ``diagnostic_msgs/DiagnosticArray``, which ROS 2 robots collect on ``/diagnostics``."""

from dataclasses import dataclass
from typing import Final

from lidario.basics.model import DeviceInfo, Health, HealthStatus, Stats
from lidario.scans.cdr import CdrWriter

OK: Final = 0
WARN: Final = 1
ERROR: Final = 2
STALE: Final = 3
"""The levels of ``diagnostic_msgs/DiagnosticStatus``."""

_LEVELS: Final = {HealthStatus.OK: OK, HealthStatus.WARNING: WARN, HealthStatus.ERROR: ERROR}


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """The fields of ``diagnostic_msgs/DiagnosticStatus``.

    Attributes:
        level: `OK`, `WARN`, `ERROR` or `STALE`.
        name: What it is about.
        message: Its state in words.
        hardware_id: Serial number.
        values: Further names and values.
    """

    level: int
    name: str
    message: str
    hardware_id: str
    values: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class DiagnosticArray:
    """The fields of ``diagnostic_msgs/DiagnosticArray``.

    Attributes:
        stamp_ns: Wall clock, nanoseconds since the Unix epoch.
        status: What is reported.
        frame_id: Of the header; empty by convention.
    """

    stamp_ns: int
    status: tuple[DiagnosticStatus, ...]
    frame_id: str = ""

    def to_cdr(self) -> bytes:
        """The message as ROS 2 sends and stores it: CDR, lowest byte first."""
        writer = CdrWriter()
        writer.header(self.stamp_ns, self.frame_id)
        writer.uint32(len(self.status))
        for each in self.status:
            writer.byte(each.level)
            writer.text(each.name)
            writer.text(each.message)
            writer.text(each.hardware_id)
            writer.uint32(len(each.values))
            for name, value in each.values:
                writer.text(name)
                writer.text(value)
        return writer.finish()


def diagnostics(
    stamp_ns: int,
    name: str,
    info: DeviceInfo,
    health: Health,
    *,
    stats: Stats | None = None,
    rate: float = 0.0,
    lost: str = "",
) -> DiagnosticArray:
    """What a lidar says of itself, and what its session has counted.

    Args:
        stamp_ns: Wall clock, nanoseconds since the Unix epoch.
        name: Name of the status, such as ``lidario: scan``.
        info: The device.
        health: What it last said of its state.
        stats: Counters of the session.
        rate: Scans a second at the moment.
        lost: Why the device is away; empty where it is not. Then the level is `ERROR`.
    """
    level = ERROR if lost else _LEVELS[health.status]
    words = lost or health.note or {OK: "OK", WARN: "warning", ERROR: "error"}[level]
    values = [
        ("model", info.model),
        ("firmware", info.firmware),
        ("health", health.status.value),
        ("health code", str(health.code)),
        ("scans a second", f"{rate:.2f}"),
    ]
    if stats is not None:
        values += [
            ("scans", str(stats.scans)),
            ("lost packets", str(stats.lost_packets)),
            ("broken scans", str(stats.broken_scans)),
            ("reconnects", str(stats.reconnects)),
            ("protection stops", str(stats.protection_stops)),
            ("line", stats.line_trouble or "OK"),
        ]
    return DiagnosticArray(stamp_ns, (DiagnosticStatus(level, name, words, info.serial, tuple(values)),))
