"""Requests of the RPLIDAR protocol, with the response, the timeout and the settle time of each.

Codes, payloads and responses: S-series interface manual, chapter "Requests and responses". The vendor's SDK 2.1.0
for what the manual leaves out: FORCE_SCAN, HQ_SCAN, the accessory board, the configuration types 0x00 to 0x05, the
byte tables of GET_INFO and GET_LIDAR_CONF.

Settle times: the manual demands at least 10 ms after STOP and at least 500 ms after RESET before the next
request; the SDK waits 10 ms after a motor request. Timeouts are ours: a healthy device responds to a query within
a few milliseconds, and the SDK allows 500 ms while it connects.
"""

import struct
from enum import IntEnum
from typing import Final

from lidario.families.rplidar.formats import FORMATS
from lidario.wire.envelope import Expected, Request, encode_request
from lidario.wire.formats import StreamFormat

SETTLE_S: Final = 0.010
"""Pause after STOP, by the protocol manual, and after motor commands, for which only the SDK has a figure."""
RESET_SETTLE_S: Final = 0.500
HQ_PAYLOAD: Final = 33
QUERY_TIMEOUT_S: Final = 0.5
SCAN_TIMEOUT_S: Final = 2.0
LONGEST_CONF: Final = 4 + 255
"""Largest GET_LIDAR_CONF response that is believed: the echoed type and a value. Mode names have about ten letters;
no document bounds them."""


class Conf(IntEnum):
    """Configuration types of GET_LIDAR_CONF; those from 0x71 to 0x7F, except 0x79 and 0x7C, take a mode id."""

    DESIRED_ROTATION = 0x01
    MIN_ROTATION = 0x04
    MAX_ROTATION = 0x05
    MODE_COUNT = 0x70
    SAMPLE_DURATION = 0x71
    MAX_DISTANCE = 0x74
    RESPONSE_TYPE = 0x75
    MAC_ADDRESS = 0x79
    TYPICAL_MODE = 0x7C
    MODE_NAME = 0x7F
    NETWORK_ADDRESS = 0x0001CCC0


def _query(name: str, data: bytes, expects: Expected) -> Request:
    return Request(name, data, expects, QUERY_TIMEOUT_S)


FILL: Final = Request("FILL", bytes(HQ_PAYLOAD + 3))
"""Completes the longest request, which may lack its length, payload and checksum. A length of 0 ends it at once."""
STOP: Final = Request("STOP", encode_request(0x25), settle=SETTLE_S, ends_stream=True)
RESET: Final = Request("RESET", encode_request(0x40), settle=RESET_SETTLE_S, ends_stream=True, boots=True)
GET_INFO: Final = _query("GET_INFO", encode_request(0x50), Expected(0x04, 20))
GET_HEALTH: Final = _query("GET_HEALTH", encode_request(0x52), Expected(0x06, 3))
GET_SAMPLERATE: Final = _query("GET_SAMPLERATE", encode_request(0x59), Expected(0x15, 4))
GET_ACC_BOARD_FLAG: Final = Request("GET_ACC_BOARD_FLAG", encode_request(0xFF, bytes(4)), Expected(0xFF, 4), 0.25)
"""Asked twice, which takes half a second as in the SDK. A device without an accessory board is silent."""
DTR_STOPS: Final = Request("motor off by DTR", b"", dtr=True)
DTR_TURNS: Final = Request("motor on by DTR", b"", dtr=False)
"""The polarity of the A1's USB board: asserted stops the motor (SDK 2.1.0, `net_serial.cpp`)."""


def get_lidar_conf(kind: Conf, mode: int | None = None) -> Request:
    """GET_LIDAR_CONF for one configuration type; if the type takes a scan mode, for that mode.

    The response echoes the type. The value behind it is absent if the device does not know the type.
    """
    echo = struct.pack("<I", kind)
    payload = echo if mode is None else echo + struct.pack("<H", mode)
    return _query(
        f"GET_LIDAR_CONF {kind.name}" + ("" if mode is None else f" of mode {mode}"),
        encode_request(0x84, payload),
        Expected(0x20, 4, LONGEST_CONF, prefix=echo),
    )


def set_lidar_conf(kind: Conf, value: bytes) -> Request:
    """SET_LIDAR_CONF; the response is the type and a result, 0 for success."""
    echo = struct.pack("<I", kind)
    expected = Expected(0x21, 8, prefix=echo)
    return _query(f"SET_LIDAR_CONF {kind.name}", encode_request(0x85, echo + value), expected)


def motor_speed(rpm: int) -> Request:
    """MOTOR_SPEED_CTRL: the speed in revolutions a minute, 0 for off. It has no response."""
    return Request("MOTOR_SPEED_CTRL", encode_request(0xA8, struct.pack("<H", rpm)), settle=SETTLE_S)


def motor_pwm(duty: int) -> Request:
    """SET_MOTOR_PWM of an accessory board: a duty from 0, which is off, to 1023. It has no response."""
    return Request("SET_MOTOR_PWM", encode_request(0xF0, struct.pack("<H", duty)), settle=SETTLE_S)


def hq_scan(stream: StreamFormat) -> Request:
    """HQ_SCAN: a flag byte and 32 reserved ones."""
    return _start("HQ_SCAN", encode_request(0x83, bytes(HQ_PAYLOAD)), stream)


def scan(stream: StreamFormat, *, force: bool = False) -> Request:
    """SCAN, or FORCE_SCAN, which measures even while the motor is not up to speed."""
    name, command = ("FORCE_SCAN", 0x21) if force else ("SCAN", 0x20)
    return _start(name, encode_request(command), stream)


def express_scan(mode: int, stream: StreamFormat) -> Request:
    """EXPRESS_SCAN in one of the device's modes: the mode id and four reserved bytes."""
    return _start("EXPRESS_SCAN", encode_request(0x82, struct.pack("<BI", mode, 0)), stream)


def _start(name: str, data: bytes, stream: StreamFormat) -> Request:
    announced = Expected(stream.response_type, stream.shortest, continuous=True)
    # The descriptor decides which format follows; the configuration, type 0x75, only predicts it.
    others = tuple(kind() for number, kind in FORMATS.items() if number != stream.response_type)
    return Request(name, data, expects=announced, timeout=SCAN_TIMEOUT_S, stream=stream, others=others)
