"""The records that a user gets: a scan, and what a device says of itself.

A scan is arrays, never objects per sample. Angles follow the robotics convention (REP-103): radians,
counter-clockwise seen from above, 0 along the device's forward axis. The device's own figures, clockwise
degrees and millimetres, stand beside them untouched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import SupportsIndex, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from lidario.laserscan import BeamOrder, LaserScan, NoReturn, follow_rotor, resample

__all__ = ["DeviceInfo", "Health", "HealthStatus", "SampleRate", "Scan", "ScanMode", "Stats"]

FloatArray = NDArray[np.float32]
_ArrayT = TypeVar("_ArrayT", bound=NDArray[np.generic])


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scan:
    """One full revolution, its samples in the order they were measured. All arrays are read-only, shape (n,).

    The device's own figures are the ones held; `angles` and `ranges` are made from them on first use, so that the
    convention that is not used costs nothing.

    Attributes:
        device_angles: Degrees, float32, clockwise, in [0, 360): the device's own convention.
        device_distances: Millimetres, float32; 0 where nothing came back: the device's own convention.
        intensities: uint8, the device's own scale of 0..255; None where the format carries none.
        stamp_ns: When the first sample was measured, on the monotonic clock of the event loop.
        wall_stamp_ns: The same instant in nanoseconds since the Unix epoch.
        time_increment_ns: Time from one sample to the next.
        duration_ns: Time from the first sample to the end of the revolution.
        rpm: Measured speed: revolutions a minute, from the time between the beginnings of this revolution and the
            one before. Where that one was not seen, from the samples of this one; NaN where some are missing too.
        seq: Number of the revolution since the session was opened, 0 for the first. It jumps by the revolutions
            that are missing in between. Those that pass while a query interrupts the stream have no number.
        dropped_before: Scans this reader missed since the one before, because it was slow.
        lost_packets: Packets of this revolution that were damaged or lost on the wire; their samples are absent. Of
            a revolution that was lost as a whole `seq` tells.
        mode: Name of the scan mode.
        max_range: Farthest distance of the scan mode in metres; 0 when the device does not say. It describes the
            mode and filters nothing: returns from beyond are in the arrays.
        seam: Device angle where revolutions begin, degrees; a device that marks its own first packet may begin
            elsewhere.
    """

    device_angles: FloatArray
    device_distances: FloatArray
    intensities: NDArray[np.uint8] | None
    stamp_ns: int
    wall_stamp_ns: int
    time_increment_ns: int
    duration_ns: int
    rpm: float
    seq: int
    dropped_before: int
    lost_packets: int
    mode: str
    max_range: float = 0.0
    seam: float = 0.0
    _angles: FloatArray | None = field(default=None, init=False)
    _ranges: FloatArray | None = field(default=None, init=False)
    # What a sorted scan was made from: only samples in the order of measuring tell their times.
    _measured: Scan | None = field(default=None, init=False)

    def __len__(self) -> int:
        return len(self.device_distances)

    def __repr__(self) -> str:
        hits = int(np.count_nonzero(self.device_distances))
        return (
            f"<Scan {self.seq}: {len(self)} samples, {hits} returns, {self.rpm:.0f} rpm, "
            f"{self.lost_packets} packets lost, {self.dropped_before} scans dropped before>"
        )

    @property
    def angles(self) -> FloatArray:
        """Radians, float32, counter-clockwise, in [-pi, pi]; 0 is the device's forward axis."""
        if self._angles is None:
            # 360 is added to degrees, where that is exact.
            radians = (self.device_angles > 180.0) * np.float32(360.0)
            radians -= self.device_angles
            radians *= math.pi / 180.0
            object.__setattr__(self, "_angles", read_only(radians))
        return cast("FloatArray", self._angles)

    @property
    def ranges(self) -> FloatArray:
        """Metres, float32; NaN where nothing came back."""
        if self._ranges is None:
            metres = self.device_distances / np.float32(1000)
            metres[self.device_distances <= 0] = np.nan
            object.__setattr__(self, "_ranges", read_only(metres))
        return cast("FloatArray", self._ranges)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the samples with a return, shape (n,)."""
        return self.device_distances > 0

    def xy(self) -> NDArray[np.float32]:
        """Cartesian points in metres, float32, shape (n, 2): x forward, y left; NaN rows without a return."""
        return np.stack((self.ranges * np.cos(self.angles), self.ranges * np.sin(self.angles)), axis=1)

    def sorted(self) -> Scan:
        """The same scan with its samples by ascending `angles`; they are no longer in time order.

        `to_laserscan` of the sorted scan gives the same as that of this one.
        """
        order = np.argsort(self.angles, kind="stable")
        made = replace(
            self,
            device_angles=read_only(self.device_angles[order]),
            device_distances=read_only(self.device_distances[order]),
            intensities=None if self.intensities is None else read_only(self.intensities[order]),
        )
        object.__setattr__(made, "_measured", self if self._measured is None else self._measured)
        return made

    def to_laserscan(
        self,
        beams: SupportsIndex | None = None,
        *,
        order: BeamOrder = "counter-clockwise",
        frame_id: str = "laser",
        range_min: float = 0.05,
        range_max: float | None = None,
        no_return: NoReturn = "inf",
        mount_yaw: float = 0.0,
    ) -> LaserScan:
        """Resample onto an even grid of angles, as the ROS message ``sensor_msgs/LaserScan`` needs it.

        ``stamp + i * time_increment`` is the time at which beam ``i`` was measured, for every ``i``, also with
        lost packets. The grid covers the circle from 0 to 2 pi, each beam in the middle of its step. In the
        default order `time_increment` is negative: the device turns clockwise, so the first beam of a
        counter-clockwise grid is the one measured last. `lidario.laserscan` explains the choice.

        A revolution that does not begin at `seam` (a device that marks its own first packet; formats that correct
        the angle) moves the grid: `angle_min` then follows the begin of the revolution, and may differ from scan
        to scan. `mount_yaw` rotates the grid too; it begins in [-pi, pi).

        Args:
            beams: Number of equal steps around the circle; None for as many as the scan has samples, which
                varies from scan to scan.
            order: ``"counter-clockwise"``: `angle_increment` is positive and `time_increment` negative.
                ``"measured"``: the same beams in the order of measuring, `angle_increment` is negative and
                `time_increment` positive.
            frame_id: Name of the coordinate frame.
            range_min: Metres; nearer returns count as no return.
            range_max: Metres; farther returns count as no return. None: the message states `max_range` of this
                scan (40 m when the device does not say), and farther returns stay in it with their values. By the
                convention of the message its readers ignore these; none is lost here without being asked for.
            no_return: What a beam without a return becomes: ``"inf"``, ``"nan"`` or ``"zero"``.
            mount_yaw: Angle of the device's forward axis in the frame, radians counter-clockwise.

        Raises:
            TypeError: `beams` is not a whole number.
            ValueError: `beams` is less than one (also by default, for a scan without samples), `order` or
                `no_return` is not one of the words, `mount_yaw` is not finite, or `range_min` and `range_max` are
                not a range.
        """
        scan = self if self._measured is None else self._measured
        rotor = follow_rotor(
            scan.device_angles, scan.time_increment_ns, scan.duration_ns, scan.seam, scan.lost_packets
        )
        return resample(
            scan.device_angles,
            scan.ranges,
            scan.intensities,
            rotor,
            scan.wall_stamp_ns,
            beams=beams,
            order=order,
            frame_id=frame_id,
            range_min=range_min,
            range_max=range_max,
            max_range=scan.max_range,
            no_return=no_return,
            mount_yaw=mount_yaw,
        )


def read_only(array: _ArrayT) -> _ArrayT:
    """The same array, made read-only, since every reader of a stream holds the same one."""
    array.setflags(write=False)
    return array


class HealthStatus(Enum):
    """What the device thinks of its own state."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Health:
    """Response to a health request.

    Attributes:
        status: ``ERROR`` means the device protects itself and will not scan.
        code: The device's error code; the vendors do not publish what the codes mean.
        note: What is unusual about the response, or its absence, for people; mostly empty.
    """

    status: HealthStatus
    code: int
    note: str = ""

    @property
    def ok(self) -> bool:
        """Whether the device will scan."""
        return self.status is not HealthStatus.ERROR


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """What the device says it is.

    Attributes:
        family: Name of the protocol family in lidario.
        model: Model name, derived from the model number.
        model_id: The model number as the device sent it.
        firmware: ``major.minor``.
        hardware: Hardware revision.
        serial: Serial number, in the notation the vendor's own programs print.
    """

    family: str
    model: str
    model_id: int
    firmware: str
    hardware: int
    serial: str


@dataclass(frozen=True, slots=True)
class SampleRate:
    """Time a sample takes.

    Attributes:
        standard_us: Microseconds a sample in the standard mode.
        express_us: Microseconds a sample in the express mode.
    """

    standard_us: float
    express_us: float


@dataclass(frozen=True, slots=True)
class ScanMode:
    """One way in which the device can measure.

    Attributes:
        id: The device's number for it; numbers differ from model to model.
        name: The device's name for it.
        sample_us: Microseconds a sample; 0 when the device does not say.
        max_distance: Farthest distance in metres; 0 when the device does not say.
        answer_type: Type byte of the stream it sends.
        typical: Whether the device recommends it.
    """

    id: int
    name: str
    sample_us: float
    max_distance: float
    answer_type: int
    typical: bool = False

    @property
    def samples_per_second(self) -> float:
        """Samples a second; NaN when the device does not say."""
        return 1e6 / self.sample_us if self.sample_us else math.nan


@dataclass(frozen=True, slots=True)
class Stats:
    """Counters of one session since it was opened; a snapshot.

    Two sums close at any time, whatever was damaged or lost: each received byte is counted in exactly one of
    `packet_bytes`, `record_bytes`, `skipped_bytes`, `response_bytes`, `stray_bytes`, `drained_bytes`,
    `discarded_bytes` and `buffered`; each packet in exactly one of `scan_packets`, `discarded_packets` and
    `unfinished_packets`.

    Attributes:
        bytes_received: All bytes that came in.
        packets: Intact measurement packets.
        packet_bytes: Their bytes.
        lost_packets: Packets known to be missing: from the jump in the angle, and from the time where whole
            revolutions are missing.
        scan_packets: Packets of the scans that were delivered.
        discarded_packets: Packets of revolutions that were not delivered: broken ones, the parts of a revolution at
            the beginning and the end of a stream, and what nobody had asked for.
        unfinished_packets: Packets of the revolution in the making.
        records: Known records between packets that carry no measurement.
        record_bytes: Their bytes.
        skipped_bytes: Bytes of a stream that belong to no packet.
        skipped_stretches: Stretches of such bytes.
        response_bytes: Responses that were waited for, and what announces a stream.
        stray_bytes: Bytes outside a stream that are no response.
        drained_bytes: Bytes thrown away after a STOP: what the device had still to send.
        discarded_bytes: Bytes that were received but thrown away unparsed, because the program was too slow.
        buffered: Bytes received that belong to nothing complete yet.
        late_responses: Responses to an earlier question, thrown away.
        scans: Full revolutions.
        broken_scans: Revolutions thrown away because so much of them was missing that they could not be told apart.
        missed_scans: Revolutions missing between the scans, by which `Scan.seq` jumps: broken ones, those of
            which nothing came, and, reckoned by the speed before, those that passed while the device was away
            (`reconnects`). What passes while the stream is interrupted is not counted.
        dropped_scans: Scans that slow readers missed, summed over all readers.
        interruptions: Times a stream was stopped for a query and started again.
        keepalives: Keepalive requests sent.
        reconnects: Times the session has found its device again after it had lost it.
    """

    bytes_received: int = 0
    packets: int = 0
    packet_bytes: int = 0
    lost_packets: int = 0
    scan_packets: int = 0
    discarded_packets: int = 0
    unfinished_packets: int = 0
    records: int = 0
    record_bytes: int = 0
    skipped_bytes: int = 0
    skipped_stretches: int = 0
    response_bytes: int = 0
    stray_bytes: int = 0
    drained_bytes: int = 0
    discarded_bytes: int = 0
    buffered: int = 0
    late_responses: int = 0
    scans: int = 0
    broken_scans: int = 0
    missed_scans: int = 0
    dropped_scans: int = 0
    interruptions: int = 0
    keepalives: int = 0
    reconnects: int = 0
