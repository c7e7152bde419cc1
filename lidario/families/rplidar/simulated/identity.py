"""What a device tells of itself: every single response, and the descriptor before it or before a stream.

GET_INFO, GET_HEALTH, GET_SAMPLERATE and GET_LIDAR_CONF as in the S-series interface manual; the flag of the
accessory board and the static address as in vendor SDK 2.1.0. An address that SET_LIDAR_CONF has set is in force
after the next RESET, as with the vendor's tool.
"""

import struct
from typing import Final

from lidario.families.rplidar.simulated.profile import Mode, Profile
from lidario.families.rplidar.simulated.requests import Request

# Response types of single responses.
INFO, HEALTH, SAMPLERATE, CONF, CONF_SET, BOARD = 0x04, 0x06, 0x15, 0x20, 0x21, 0xFF
ADDRESS: Final = 0x0001CCC0  # type of configuration of the static address, 12 bytes (frame_grabber of the SDK)

_CONTINUOUS: Final = 1 << 30  # send mode in the descriptor's length word
_DHCP = bytes(12)


class Identity:
    """What tells one device from others of its model, and what it was set to: its serial number, of 16 bytes."""

    def __init__(self, serial: bytes) -> None:
        if len(serial) != 16:
            raise ValueError(f"a serial number has 16 bytes, not {len(serial)}")
        self.address: bytes = _DHCP  # address, mask and gateway of an Ethernet device
        self._serial = serial
        self._next_address = _DHCP

    def restart(self) -> None:
        """What was set comes into force."""
        self.address = self._next_address

    def respond(self, request: Request, profile: Profile, health: tuple[int, int]) -> tuple[int, bytes] | None:
        """Type and payload of the response to a question or a setting; None where the firmware does not know it."""
        match request.name:
            case "get_info":
                major, minor = profile.firmware
                head = bytes([profile.model, minor, major, profile.hardware])
                return INFO, head + self._serial
            case "get_health":
                return HEALTH, struct.pack("<BH", *health)
            case "get_samplerate":
                standard = profile.standard.said_us_q8
                express = standard if profile.express is None else profile.express.said_us_q8
                return SAMPLERATE, struct.pack("<HH", standard >> 8, express >> 8)
            case "get_lidar_conf":
                value = self.conf(profile, request.payload)
                return None if value is None else (CONF, request.payload[:4] + value)
            case "set_lidar_conf":
                return self._set_conf(request.payload)
            case "get_acc_board_flag":
                return BOARD, struct.pack("<I", 1)
            case _:
                return None

    def conf(self, profile: Profile, payload: bytes) -> bytes | None:
        """The value that GET_LIDAR_CONF asks for; None where the firmware does not know its type."""
        kind = int.from_bytes(payload[:4], "little")
        if kind == ADDRESS and profile.is_network:
            return self.address
        return profile.conf(kind, payload[4:])

    def _set_conf(self, payload: bytes) -> tuple[int, bytes] | None:
        kind = int.from_bytes(payload[:4], "little")
        if kind != ADDRESS:
            return None
        self._next_address = payload[4:]
        return CONF_SET, struct.pack("<II", kind, 0)


def pack_response(kind: int, data: bytes) -> bytes:
    """A single response."""
    return _descriptor(len(data), kind) + data


def pack_announcement(mode: Mode) -> bytes:
    """The descriptor of a stream, before its first packet."""
    return _descriptor(mode.packet[0] | _CONTINUOUS, mode.response_type)


def _descriptor(length: int, kind: int) -> bytes:
    """``A5 5A``, length of one packet with the send mode in the top bits, response type."""
    return struct.pack("<BBIB", 0xA5, 0x5A, length, kind)
