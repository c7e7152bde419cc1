"""The ROS message ``sensor_msgs/LaserScan`` as a record, and its bytes; `lidario.scans.beams` makes one."""

import struct
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import shown
from lidario.errors import InvalidValue
from lidario.scans.cdr import CdrReader, CdrWriter, NotCdr
from lidario.scans.plain import plain_of

_SEVEN_AND_COUNT = struct.Struct("<7fI")
_LENGTH = struct.Struct("<I")
_FLOATS = np.dtype("<f4")


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """The fields of ``sensor_msgs/LaserScan``, by the same names.

    For every ``i``, ``ranges[i]`` was measured at the angle ``angle_min + i * angle_increment`` and at the time
    ``stamp_ns + i * time_increment * 1e9``.

    Attributes:
        stamp_ns: Wall clock of ``ranges[0]`` in nanoseconds since the Unix epoch.
        frame_id: Name of the coordinate frame.
        angle_min: Angle of ``ranges[0]``, radians counter-clockwise.
        angle_max: Angle of ``ranges[-1]``. Less than `angle_min` in the order of measuring.
        angle_increment: Angle from one beam to the next, radians. Negative in the order of measuring.
        time_increment: Seconds from one beam to the next. Negative in counter-clockwise order, because the device
            turns clockwise: ``ranges[0]`` was measured last.
        scan_time: Seconds a revolution takes.
        range_min: Shortest valid range, metres.
        range_max: Longest valid range, metres.
        ranges: Metres, float32, shape (beams,).
        intensities: float32, shape (beams,), or (0,) where the format carries none.
    """

    stamp_ns: int
    frame_id: str
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    scan_time: float
    range_min: float
    range_max: float
    ranges: NDArray[np.float32]
    intensities: NDArray[np.float32]

    def to_dict(self) -> dict[str, Any]:
        """The message as plain numbers and lists, for JSON; ``units`` names the unit of each field.

        What is not a finite number is None, as JSON has neither NaN nor infinite numbers: of `ranges`, the beams
        without a return and those without a sample.
        """
        return plain_of(self, [each.name for each in fields(self)])

    def to_cdr(self) -> bytes:
        """The message as ROS 2 sends and stores it: CDR, lowest byte first.

        A stamp after 2038 does not fit in the message, and is written as its end.
        """
        head = CdrWriter()
        head.header(self.stamp_ns, self.frame_id)
        head.align(4)
        angles = self.angle_min, self.angle_max, self.angle_increment
        limits = self.time_increment, self.scan_time, self.range_min, self.range_max
        head.raw(_SEVEN_AND_COUNT.pack(*angles, *limits, len(self.ranges)))
        ranges, intensities = (each.astype(_FLOATS, copy=False) for each in (self.ranges, self.intensities))
        return b"".join((head.finish(), ranges.tobytes(), _LENGTH.pack(len(intensities)), intensities.tobytes()))

    @classmethod
    def from_cdr(cls, data: bytes) -> Self | None:
        """The message that anybody's `to_cdr` wrote; None where the bytes are none.

        A length in the data is checked against the bytes that are there. The numbers in it may be anything.

        Raises:
            InvalidValue: `data` is not bytes.
        """
        if not isinstance(data, bytes | bytearray | memoryview):
            raise InvalidValue(f"a message is bytes, not {shown(data)}")
        try:
            reader = CdrReader(bytes(data))
            # In the order of the message, which is that of the arguments.
            return cls(
                stamp_ns=reader.stamp_ns(),
                frame_id=reader.text(),
                angle_min=reader.float32(),
                angle_max=reader.float32(),
                angle_increment=reader.float32(),
                time_increment=reader.float32(),
                scan_time=reader.float32(),
                range_min=reader.float32(),
                range_max=reader.float32(),
                ranges=reader.float_sequence(),
                intensities=reader.float_sequence(),
            )
        except NotCdr:
            return None
