"""Which devices can be simulated: those that are sold, one for each other format, and awkward ones.

**Sold**: S1, S2, S3. Where sources differ, the log of a real device counts. The sources of the figures:

==============  =======================================================================================
model byte      logs of S1M1 (0x61) and S2M1 (0x71); 0x81 for the S3 follows from the naming rule of the
                vendor's SDK 2.1.0
firmware        the same logs: S1 1.28, S2 and S3 1.02, all hardware 18
baud rate       launch files of the vendor's ROS driver
S1 modes        the log of one device: 244 µs and 108 µs a sample, 40 m in both modes. The S-series
                interface manual, figure 3-3, prints 4600 and 9200 samples a second, and 16 m for Standard
S2 modes        rates: figure 3-3 and logs agree. Distances: a log, 30 m in both modes; figure 3-3 prints
                16 m for Standard
S3 modes        rates and distances: rplidar_ros issue 150; figure 3-3 does not have the S3. No source has the
                response type of its DenseBoost; 0x85 is assumed
typical mode    logs: DenseBoost
speeds          S2: a user's report of conf 0x01, 0x04 and 0x05; S1 and S3 are assumed to tell the same
boot time       S1: users report 2 s; the others: the manual's 500 ms and a little more
==============  =======================================================================================

**Formats**: `rplidar-express`, `-hq`, `-ultra` and `-ultradense` stand for no product; each sends one more format.

**Awkward**: modes whose numbers have holes and that come without conf 0x01; 0 µs a sample (rplidar_ros issue 155);
a response type that no host knows; an empty list of modes (rplidar_ros issue 168); firmware older than 1.24, which
has no GET_LIDAR_CONF.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

__all__ = ["PACKET", "PROFILES", "Mode", "Profile"]

# Response type -> bytes and samples of one packet (S-series interface manual; packed structs of SDK 2.1.0).
PACKET = {0x81: (5, 1), 0x82: (84, 32), 0x83: (781, 96), 0x84: (132, 96), 0x85: (84, 40), 0x86: (170, 64)}


# Conf types (S-series interface manual, GET_LIDAR_CONF; 0x01, 0x04, 0x05 from vendor SDK 2.1.0).
_SPEED_CONFS = {0x01: 0, 0x04: 1, 0x05: 2}
_MODE_CONFS: dict[int, Callable[[Mode], bytes]] = {
    0x71: lambda mode: struct.pack("<I", mode.said_us_q8),
    0x74: lambda mode: struct.pack("<I", mode.max_distance_q8),
    0x75: lambda mode: struct.pack("<B", mode.response_type),
    0x7F: lambda mode: mode.name.encode("ascii") + b"\0",
}


@dataclass(frozen=True, slots=True)
class Mode:
    """One scan mode of a simulated device.

    Attributes:
        id: What EXPRESS_SCAN calls it.
        name: What the device calls it.
        response_type: Response type, 0x81..0x86 or one that no host knows.
        us_q8: Microseconds a sample in 1/256, as it is.
        max_distance_q8: Longest range in 1/256 m.
        reported_us_q8: Microseconds a sample as the device *says* (conf 0x71); None = truthfully.
        layout: Response type whose packets are sent; None = that of `response_type`.
    """

    id: int
    name: str
    response_type: int
    us_q8: int
    max_distance_q8: int
    reported_us_q8: int | None = None
    layout: int | None = None

    @property
    def said_us_q8(self) -> int:
        """The response to conf 0x71."""
        return self.us_q8 if self.reported_us_q8 is None else self.reported_us_q8

    @property
    def packet(self) -> tuple[int, int]:
        """Bytes and samples of one packet."""
        return PACKET[self.format]

    @property
    def format(self) -> int:
        """The response type whose packets are sent."""
        return self.response_type if self.layout is None else self.layout

    @property
    def period_ns(self) -> int:
        """Nanoseconds from packet to packet."""
        return self.us_q8 * 1000 * self.packet[1] // 256


@dataclass(frozen=True, slots=True)
class Profile:
    """What a simulated device is.

    Attributes:
        name: What users call it (``sim://`` and then this).
        model: Model byte of GET_INFO, major and minor nibble.
        firmware: Major and minor.
        hardware: Hardware revision.
        baudrate: Bits a second.
        kind: Whether such a device is ``"sold"``, or stands for a ``"format"``, or is ``"awkward"``.
        modes: Scan modes; EXPRESS_SCAN knows these ids and no others.
        typical: Id of the mode conf 0x7C names.
        listed: Whether GET_LIDAR_CONF tells of the modes.
        has_conf: Whether the firmware has GET_LIDAR_CONF at all.
        speed_conf: Desired, least and greatest rpm (conf 0x01, 0x04, 0x05); None = the firmware does not know them.
        motor_command: Whether MOTOR_SPEED_CTRL is obeyed; without it the motor always runs.
        boot_s: Silence after RESET.
        banner: What is printed when booting is over; empty for most.

    Raises:
        ValueError: A mode makes more bytes than the line can carry.
    """

    name: str
    model: int
    baudrate: int
    modes: tuple[Mode, ...]
    typical: int
    kind: Literal["sold", "format", "awkward"] = "awkward"
    firmware: tuple[int, int] = (1, 29)
    hardware: int = 18
    listed: bool = True
    has_conf: bool = True
    speed_conf: tuple[int, int, int] | None = (600, 480, 1200)
    motor_command: bool = True
    boot_s: float = 0.6
    banner: bytes = b""

    def __post_init__(self) -> None:
        for mode in self.modes:
            if mode.packet[0] * 10 * 1_000_000_000 > mode.period_ns * self.baudrate:
                raise ValueError(f"{self.name}: {self.baudrate} baud cannot carry mode {mode.name}")

    def conf(self, kind: int, arguments: bytes) -> bytes | None:
        """The value of one GET_LIDAR_CONF entry; empty when there is none for these arguments.

        None when the firmware does not know the entry. To that the device sends no response: the vendor's SDK 2.1.0
        asks for the MAC address (0x79) to tell Ethernet devices, and takes any response for a yes.
        """
        if kind in _SPEED_CONFS and self.speed_conf is not None:
            rpm = self.speed_conf[_SPEED_CONFS[kind]]
            return struct.pack("<HH", rpm, 0) if kind == 0x01 else struct.pack("<H", rpm)
        if kind == 0x70:
            return struct.pack("<H", len(self.modes) if self.listed else 0)
        if kind == 0x7C:
            return struct.pack("<H", self.typical) if self.listed else b""
        if kind not in _MODE_CONFS:
            return None
        mode = self.mode(int.from_bytes(arguments[:2], "little")) if len(arguments) >= 2 and self.listed else None
        return b"" if mode is None else _MODE_CONFS[kind](mode)

    def mode(self, mode_id: int) -> Mode | None:
        """The mode of that id, or None."""
        return next((mode for mode in self.modes if mode.id == mode_id), None)

    @property
    def legacy_express(self) -> Mode | None:
        """What EXPRESS_SCAN starts by working mode 0: 0x82, as fast as GET_SAMPLERATE tells of EXPRESS_SCAN.

        None where the line cannot carry that, and where firmware without GET_LIDAR_CONF has it among its modes.
        """
        fast = [mode for mode in self.modes if mode.response_type != 0x81]
        if not self.has_conf or not fast:
            return None
        mode = Mode(0, "Legacy express", 0x82, fast[-1].us_q8, fast[-1].max_distance_q8)
        return mode if mode.packet[0] * 10 * 1_000_000_000 <= mode.period_ns * self.baudrate else None

    @property
    def standard(self) -> Mode:
        """The mode that SCAN starts."""
        return next(mode for mode in self.modes if mode.response_type == 0x81)


def _q8(value: float) -> int:
    return round(value * 256)


def _mode(mode_id: int, name: str, response_type: int, samples_per_s: float, metres: float, **more: int) -> Mode:
    return Mode(mode_id, name, response_type, _q8(1e6 / samples_per_s), _q8(metres), **more)


def _s_series(name: str, model: int, standard_m: float, dense_m: float) -> Profile:
    modes = (_mode(0, "Standard", 0x81, 16000, standard_m), _mode(1, "DenseBoost", 0x85, 32000, dense_m))
    return Profile(name, model, 1_000_000, modes, typical=1, kind="sold", firmware=(1, 2))


def _of_format(name: str, model: int, baudrate: int, *modes: Mode) -> Profile:
    """A device that stands for the format of its last mode, which is also the typical one."""
    return Profile(name, model, baudrate, modes, typical=modes[-1].id, kind="format")


_BANNER = b"Simulated scanner 1.20, hardware 5, booted, health is good.\r\n"

_SOLD = (
    _s_series("rplidar-s2", 0x71, 30, 30),
    Profile(
        "rplidar-s1",
        0x61,
        256_000,
        (_mode(0, "Standard", 0x81, 1e6 / 244, 40), _mode(1, "DenseBoost", 0x85, 1e6 / 108, 40)),
        typical=1,
        kind="sold",
        firmware=(1, 28),
        boot_s=2.0,
    ),
    _s_series("rplidar-s3", 0x81, 16, 40),
)

_FORMATS = (
    _of_format(
        "rplidar-express",
        0x62,
        256_000,
        _mode(0, "Standard", 0x81, 4000, 16),
        _mode(1, "Express", 0x82, 8000, 16),
    ),
    _of_format(
        "rplidar-hq",
        0x72,
        1_000_000,
        _mode(0, "Standard", 0x81, 8000, 30),
        _mode(1, "HQ", 0x83, 10000, 30),
    ),
    _of_format(
        "rplidar-ultra",
        0x63,
        256_000,
        _mode(0, "Standard", 0x81, 4000, 25),
        _mode(1, "Express", 0x82, 8000, 16),
        _mode(2, "Boost", 0x84, 16000, 25),
    ),
    _of_format(
        "rplidar-ultradense",
        0x82,
        1_000_000,
        _mode(0, "Standard", 0x81, 16000, 40),
        _mode(1, "UltraDense", 0x86, 32000, 40),
    ),
)

_AWKWARD = (
    Profile(
        "rplidar-holes",
        0x72,
        1_000_000,
        (_mode(0, "Standard", 0x81, 8000, 30), _mode(5, "HQ", 0x83, 10000, 30)),
        typical=5,
        speed_conf=None,
    ),
    Profile(
        "rplidar-zero-us",
        0x81,
        1_000_000,
        (
            _mode(0, "Standard", 0x81, 16000, 40, reported_us_q8=0),
            _mode(1, "DenseBoost", 0x85, 32000, 40, reported_us_q8=0),
        ),
        typical=1,
    ),
    Profile(
        "rplidar-unknown-response",
        0x83,
        1_000_000,
        (_mode(0, "Standard", 0x81, 16000, 40), _mode(6, "Mystery", 0x8E, 32000, 40, layout=0x85)),
        typical=6,
    ),
    Profile(
        "rplidar-no-modes",
        0x71,
        1_000_000,
        (_mode(0, "Standard", 0x81, 16000, 30),),
        typical=0,
        listed=False,
    ),
    Profile(
        "rplidar-old-firmware",
        0x18,
        115_200,
        (_mode(0, "Express", 0x82, 4000, 12), _mode(0xFF, "Standard", 0x81, 2000, 12)),
        typical=0,
        firmware=(1, 20),
        hardware=5,
        has_conf=False,
        speed_conf=None,
        motor_command=False,
        banner=_BANNER,
    ),
)

PROFILES: dict[str, Profile] = {profile.name: profile for profile in (*_SOLD, *_FORMATS, *_AWKWARD)}
"""By name; the first one is what is simulated where no model is asked for."""
