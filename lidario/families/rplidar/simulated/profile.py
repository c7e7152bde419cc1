"""What a simulated device is: its numbers, its scan modes, its motor. The devices are in `profiles`."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

# Response type -> bytes and samples of one packet (S-series interface manual; packed structs of SDK 2.1.0).
PACKET = {0x81: (5, 1), 0x82: (84, 32), 0x83: (781, 96), 0x84: (132, 96), 0x85: (84, 40), 0x86: (170, 64)}


@dataclass(frozen=True, slots=True)
class Mode:
    """One scan mode of a simulated device."""

    id: int  # what EXPRESS_SCAN calls it
    name: str  # what the device calls it
    response_type: int  # response type, 0x81..0x86 or one that no host knows
    us_q8: int  # microseconds a sample in 1/256, as it is
    max_distance_q8: int  # longest range in 1/256 m
    reported_us_q8: int | None = None  # microseconds a sample as the device *says* (conf 0x71); None = truthfully
    layout: int | None = None  # response type whose packets are sent; None = that of `response_type`
    # Response type as the device *says* (conf 0x75); None = that of `response_type`, which its descriptor
    # announces.
    reported_type: int | None = None

    @property
    def said_type(self) -> int:
        """The response to conf 0x75."""
        return self.response_type if self.reported_type is None else self.reported_type

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


# Conf types (S-series interface manual, GET_LIDAR_CONF; 0x01, 0x04, 0x05 from vendor SDK 2.1.0).
_SPEED_CONFS = {0x01: 0, 0x04: 1, 0x05: 2}
_MODE_CONFS: dict[int, Callable[[Mode], bytes]] = {
    0x71: lambda mode: struct.pack("<I", mode.said_us_q8),
    0x74: lambda mode: struct.pack("<I", mode.max_distance_q8),
    0x75: lambda mode: struct.pack("<B", mode.said_type),
    0x7F: lambda mode: mode.name.encode("ascii") + b"\0",
}


@dataclass(frozen=True, slots=True)
class Profile:
    """What a simulated device is; ValueError where a mode makes more bytes than the line can carry."""

    name: str  # what users call it (``sim://`` and then this)
    model: int  # model byte of GET_INFO, major and minor nibble
    baudrate: int  # bits a second
    modes: tuple[Mode, ...]  # scan modes; EXPRESS_SCAN knows these ids and no others
    typical: int  # id of the mode conf 0x7C names
    firmware: tuple[int, int] = (1, 29)  # major and minor
    hardware: int = 18  # hardware revision
    listed: bool = True  # whether GET_LIDAR_CONF tells of the modes
    has_conf: bool = True  # whether the firmware has GET_LIDAR_CONF at all
    # Desired, least and greatest rpm (conf 0x01, 0x04, 0x05); entries that the firmware does not know are missing
    # at the end.
    speed_conf: tuple[int, ...] = (600, 480, 1200)
    # What turns it. ``"rpm"``: MOTOR_SPEED_CTRL, and SCAN where it is off. ``"pwm"``: SET_MOTOR_PWM by an accessory
    # board, which responds to 0xFF; there is no packet before. ``"dtr"``: it turns while the line DTR is cleared.
    # ``"fixed"``: it always turns.
    motor: Literal["rpm", "pwm", "dtr", "fixed"] = "rpm"
    # Its speed where no request tells one; with an accessory board the speed at a duty of 660.
    own_rpm: float = 600.0
    pwm_ref: int = 0  # the duty that conf 0x01 tells
    hq_scan: bool = False  # whether HQ_SCAN is known, which starts the mode in 0x83
    mac: bytes = b""  # its Ethernet address, by conf 0x79; empty for a serial device
    boot_s: float = 0.6  # silence after RESET
    banner: bytes = b""  # what is printed when booting is over; empty for most
    oddity: str = ""  # what is awkward about it, for people
    follows: str = ""  # which real device's bytes it follows, for people; empty where there are none

    def __post_init__(self) -> None:
        for mode in self.modes:
            if not self._carries(mode):
                raise ValueError(f"{self.name}: {self.baudrate} baud cannot carry mode {mode.name}")

    def _carries(self, mode: Mode) -> bool:
        return mode.packet[0] * 10 * 1_000_000_000 <= mode.period_ns * self.baudrate

    @property
    def about(self) -> str:
        """What it is, in a few words."""
        typical = self.mode(self.typical) or self.standard
        line = "UDP" if self.is_network else f"{self.baudrate} baud"
        motor = {"pwm": ", motor by PWM", "dtr": ", motor by DTR"}.get(self.motor, "")
        odd = f"; {self.oddity}" if self.oddity else ""
        odd += f"; like {self.follows}" if self.follows else ""
        return f"{line}, {typical.name} 0x{typical.response_type:02X} {256e6 / typical.us_q8:.0f}/s{motor}{odd}"

    @property
    def is_network(self) -> bool:
        """Whether it is reached by UDP."""
        return bool(self.mac)

    @property
    def triangulates(self) -> bool:
        """Whether its beam leaves beside its eye, as on the A series, so that returns lie beside the beam."""
        return self.model < 0x40

    @property
    def unknown(self) -> set[str]:
        """Requests that other models know, and this one does not."""
        known = {
            "motor_speed_ctrl": self.motor == "rpm",
            "set_motor_pwm": self.motor == "pwm",
            "get_acc_board_flag": self.motor == "pwm",
            "hq_scan": self.hq_scan,
            "set_lidar_conf": self.is_network,
            "new_baudrate_confirm": self.measures_speed,
        }
        return {name for name, is_known in known.items() if not is_known}

    @property
    def measures_speed(self) -> bool:
        """Whether the speed of its line can be changed: firmware 1.30, and newer series (assumed)."""
        return not self.is_network and (self.model >= 0x40 or self.firmware >= (1, 30))

    @property
    def express(self) -> Mode | None:
        """The mode whose rate GET_SAMPLERATE tells of EXPRESS_SCAN: the one in 0x82, else the fastest capsules."""
        fast = [mode for mode in self.modes if mode.response_type != 0x81]
        return next((mode for mode in fast if mode.response_type == 0x82), fast[-1] if fast else None)

    def conf(self, kind: int, arguments: bytes) -> bytes | None:
        """The value of one GET_LIDAR_CONF entry; empty when there is none for these arguments.

        None when the firmware does not know the entry. To that the device sends no response: the vendor's SDK 2.1.0
        asks for the MAC address (0x79) to tell Ethernet devices, and takes any response for a yes.
        """
        if _SPEED_CONFS.get(kind, 9) < len(self.speed_conf):
            rpm = self.speed_conf[_SPEED_CONFS[kind]]
            return struct.pack("<HH", rpm, self.pwm_ref) if kind == 0x01 else struct.pack("<H", rpm)
        if kind == 0x79 and self.mac:
            return self.mac
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

        C and S models send 0x85 (programs for a C1 and an S1). None where the line cannot carry that, and where
        firmware without GET_LIDAR_CONF has it among its modes.
        """
        fast = self.express
        if not self.has_conf or fast is None:
            return None
        kind = 0x82 if self.triangulates else 0x85
        mode = Mode(0, "Legacy express", kind, fast.us_q8, fast.max_distance_q8)
        return mode if self._carries(mode) else None

    @property
    def standard(self) -> Mode:
        """The mode that SCAN starts."""
        return next(mode for mode in self.modes if mode.response_type == 0x81)
