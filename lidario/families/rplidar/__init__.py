"""RPLIDAR: the A, C, S and T series; and where the measurement stream begins in recorded bytes.

Two formats cannot be told apart by their packets (0x82 and 0x85 have the same size, header and check value), so the
descriptor decides. The bytes before it, mostly responses to questions, are ignored.

The bytes contain no times. The usual sample times are those of the models that recommend the format: S2 for 0x81
and 0x85, S3 for 0x86 (S-series interface manual, figure 3-3, and logs of devices), A2 for 0x82 and A3 for 0x84
(logs of devices). For 0x83 none is known, and 10000 samples a second are assumed.
"""

import re
from typing import Final

from lidario.basics.model import ScanMode
from lidario.families.base import Decoder, Family, Known, RawStream, Timing, raw_stream
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.device import RplidarDevice
from lidario.families.rplidar.formats import FORMATS
from lidario.wire.envelope import DESCRIPTOR_MAGIC
from lidario.wire.formats import StreamFormat

_USUAL_US: Final = {0x81: 62.5, 0x82: 125.0, 0x83: 100.0, 0x84: 62.5, 0x85: 31.25, 0x86: 31.25}
_DESCRIPTORS: Final = re.compile(re.escape(DESCRIPTOR_MAGIC) + rb"(.{3})\x40(.)", re.DOTALL)
"""Pattern of stream descriptors, if the length is below 2 to the power of 24: length and response type."""


def find_stream(data: memoryview, known: Known) -> RawStream | None:
    """As `Family.find_stream`: behind the first descriptor of one of the six formats."""
    for found in _DESCRIPTORS.finditer(data):
        size, kind = int.from_bytes(found[1], "little"), found[2][0]
        wire = FORMATS.get(kind)
        if wire is not None and size == wire.shortest:
            return raw_stream(found.end(), wire(), DECODERS[kind](), known.sample_us or _USUAL_US[kind])
    return None


def stream_in(mode: ScanMode) -> tuple[StreamFormat, Decoder] | None:
    """As `Family.stream_in`: by the response type of the descriptor."""
    kind = mode.response_type
    return (FORMATS[kind](), DECODERS[kind]()) if kind in FORMATS else None


FAMILY: Final = Family(
    name="rplidar",
    title="RPLIDAR",
    # S2, S2L and S3; S1, A3, A2M7 and A2M12; A1 and A2M8; C1 (vendor's ROS launch files).
    baudrates=(1000000, 256000, 115200, 460800),
    timing=Timing(
        # The slowest packets are those of an A1 in Stability: one every 19.3 ms. An adapter may hold them for 16 ms
        # more.
        quiet_s=0.045,
        # Users report 2 s of silence from an S1; the vendor's ROS node gives it 15 s.
        boot_s=8.0,
        # "Request packets' format": a request must be complete within 5 s.
        forget_s=5.0,
    ),
    device=RplidarDevice,
    formats=tuple(FORMATS.values()),
    find_stream=find_stream,
    stream_in=stream_in,
)
