"""What an RPLIDAR responds to each request, for scripts that are driven by hand."""

import struct

from lidario.basics.model import ScanMode
from lidario.families.rplidar.commands import Conf, get_lidar_conf
from lidario.families.rplidar.device import RplidarDevice
from tests.support.scripts import drive

SERIAL = bytes(range(0xA0, 0xB0))
S1, S2, C1, A1 = 0x61, 0x71, 0x41, 0x18


def info(model: int = S2, firmware: tuple[int, int] = (1, 29), hardware: int = 18) -> bytes:
    major, minor = firmware
    return struct.pack("<BBBB16s", model, minor, major, hardware, SERIAL)


def identified(model: int = S2, firmware: tuple[int, int] = (1, 29)) -> RplidarDevice:
    device = RplidarDevice()
    drive(device.identify(), {b"\xa5\x50": info(model, firmware)})
    return device


def conf(kind: Conf, value: bytes | None, mode: int | None = None) -> dict[bytes, bytes | None]:
    answer = None if value is None else struct.pack("<I", kind) + value
    return {get_lidar_conf(kind, mode).data: answer}


def packed(layout: str, value: int | None) -> bytes | None:
    return None if value is None else struct.pack(layout, value)


def mode_answers(
    mode: int, name: bytes | None, us_q8: int | None, metres_q8: int | None, answer: int | None
) -> dict[bytes, bytes | None]:
    return {
        **conf(Conf.MODE_NAME, name, mode),
        **conf(Conf.SAMPLE_DURATION, packed("<I", us_q8), mode),
        **conf(Conf.MAX_DISTANCE, packed("<I", metres_q8), mode),
        **conf(Conf.RESPONSE_TYPE, packed("<B", answer), mode),
    }


LISTED: dict[bytes, bytes | None] = {
    **conf(Conf.MODE_COUNT, b"\x02\0"),
    **conf(Conf.TYPICAL_MODE, b"\x01\0"),
    **mode_answers(0, b"Standard\0", 16000, 4096, 0x81),
    **mode_answers(1, b"DenseBoost\0", 8000, 7680, 0x85),
}
DENSE_BOOST = ScanMode(1, "DenseBoost", 31.25, 30.0, 0x85, typical=True)
STANDARD = ScanMode(0, "Standard", 62.5, 16.0, 0x81)
