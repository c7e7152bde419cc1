"""One revolution, as a user gets it: arrays, never objects per sample.

Angles follow the robotics convention (REP-103): radians, counter-clockwise seen from above, 0 along the device's
forward axis. The device's own figures, clockwise degrees and millimetres, stand beside them untouched. What is
computed from the arrays is in `lidario.scans.samples`, `lidario.scans.points` and `lidario.scans.beams`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Final, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidario.basics.arguments import finite, nanoseconds, number, shown
from lidario.basics.words import counted
from lidario.errors import InvalidValue
from lidario.scans.beams import BeamOptions, BeamOrder, NoReturn, Preset, resample
from lidario.scans.laserscan import LaserScan
from lidario.scans.measured import MeasuredSamples, Return
from lidario.scans.plain import plain_of
from lidario.scans.points import Motion, Mount, Points, place
from lidario.scans.rotor import Rotor, rotor_of
from lidario.scans.samples import in_single, is_between, nearest_to, read_only

_PLAIN: Final = (
    "seq", "stamp_ns", "wall_stamp_ns", "time_increment_ns", "duration_ns", "rpm", "reported_rpm", "mode",
    "max_range", "dropped_before", "lost_packets", "angles", "ranges", "intensities",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Scan(MeasuredSamples):
    """One full revolution, its samples in the order they were measured. All arrays are read-only, shape (n,).

    The device's own figures are the ones held; `angles` and `ranges` are made from them on first use, so that the
    convention that is not used costs nothing.

    Attributes:
        device_angles: Degrees, float32, clockwise, in [0, 360): the device's own convention.
        device_distances: Millimetres, float32; 0 where nothing came back: the device's own convention.
        intensities: uint8, the device's own scale of 0..255; None where the format carries none.
        stamp_ns: When the first sample was measured, on the monotonic clock of the event loop.
        wall_stamp_ns: The same instant in nanoseconds since the Unix epoch. Where the clock is set while a stream
            runs, it goes on by the new time; in a recording, by that with which the recording began.
        time_increment_ns: Time from one sample to the next.
        duration_ns: Time from the first sample to the end of the revolution.
        rpm: Measured speed: revolutions a minute, by the step of the angle from sample to sample and the time that
            a sample takes; of a device that sends each scan as one packet, by the time between scans. NaN where so
            much is missing that the times of the other revolutions do not confirm it.
        seq: Number of the revolution since the session was opened, 0 for the first. It jumps by the revolutions
            that are missing in between. Those that pass while a request interrupts the stream have no number.
        dropped_before: Scans this reader missed since the one before, because it was slow.
        lost_packets: Packets of this revolution that were damaged or lost on the wire; their samples are absent. Of
            a revolution that was lost as a whole `seq` tells.
        mode: Name of the scan mode.
        max_range: Farthest distance of the scan mode in metres; 0 when the device does not say. It describes the
            mode and filters nothing: returns from beyond are in the arrays.
        seam: Device angle where revolutions begin, degrees; a device that marks its own first packet may begin
            elsewhere.
        reported_rpm: The speed that the device itself reported with this revolution, revolutions a minute; NaN
            where it reports none. Some do, in steps of 6, where the first packet of the revolution came intact.
        field_of_view: How much of a revolution the device sees, from `seam` on, in degrees: 360 for most. Negative
            where the rotor turns counter-clockwise. Of the rest nothing is known.
    """

    dropped_before: int
    lost_packets: int
    mode: str
    max_range: float = 0.0
    seam: float = 0.0
    reported_rpm: float = math.nan
    field_of_view: float = 360.0
    # What a sorted scan was made from: only samples in the order of measuring tell their times.
    _measured: Scan | None = field(default=None, init=False)
    # Of a selection: the rotor of the scan that it was taken from, which shows more of it.
    _rotor: Rotor | None = field(default=None, init=False)

    def __repr__(self) -> str:
        hits = int(np.count_nonzero(self.device_distances))
        return (
            f"<Scan {self.seq}: {counted(len(self), 'sample')}, {counted(hits, 'return')}, {self.rpm:.0f} rpm, "
            f"{counted(self.lost_packets, 'packet')} lost, {counted(self.dropped_before, 'scan')} dropped before>"
        )

    def sorted(self) -> Scan:
        """The same scan with its samples by ascending `angles`; they are no longer in time order.

        `to_laserscan` of the sorted scan gives the same as that of this one.
        """
        made = self._taken(np.argsort(self.angles, kind="stable"))
        vars(made)["_measured"] = self._in_time_order()
        return made

    def at(self, angle: float, *, within: float = math.radians(1.0)) -> Return | None:
        """The sample nearest to an angle; its range is NaN where nothing came back.

        Args:
            angle: Radians counter-clockwise, 0 ahead.
            within: How far away it may be, radians.

        Returns:
            None where no sample is near enough, because packets are missing there.

        Raises:
            InvalidValue: `angle` is not finite or more than a turn, or `within` is negative or not a number.
        """
        index = nearest_to(self.angles, angle, within)
        return None if index is None else self._return(index)

    def select(
        self,
        mask: ArrayLike | None = None,
        *,
        between: tuple[float, float] | None = None,
        range_min: float | None = None,
        range_max: float | None = None,
    ) -> Scan:
        """The same revolution with only some of its samples: those for which everything that is given holds.

        Every sample keeps its time, and `to_laserscan` of the selection has the same grid of times as that of the
        whole scan. ::

            front = scan.select(between=(-1.57, 1.57), range_max=5.0)

        Args:
            mask: Which samples, bool, shape (n,): for example ``scan.intensities > 30``.
            between: From the first angle counter-clockwise to the second, radians.
            range_min: Metres; nearer returns are left out, and samples without a return.
            range_max: Metres; farther returns are left out, and samples without a return.

        Raises:
            InvalidValue: The mask is not bool or not of shape (n,), `between` is not two finite angles, or a limit
                is no number.
        """
        keep = np.ones(len(self), np.bool_)
        if mask is not None:
            try:
                given = np.asarray(mask)
            except ValueError:
                raise InvalidValue(f"the mask is an array of bool, not {shown(mask)}") from None
            if given.dtype != np.bool_ or given.shape != keep.shape:
                raise InvalidValue(
                    f"the mask must be bool, one value a sample, shape ({len(self)},), not {given.dtype} of shape "
                    f"{given.shape}"
                )
            keep &= given
        if between is not None:
            keep &= is_between(self.angles, between)
        if range_min is not None:
            keep &= self.ranges >= in_single(number(range_min, "range_min"))
        if range_max is not None:
            keep &= self.ranges <= in_single(number(range_max, "range_max"))
        if self._measured is not None:
            order = np.argsort(self._measured.angles, kind="stable")
            measured = np.zeros_like(keep)
            measured[order] = keep
            return self._measured.select(measured).sorted()
        made = self._taken(keep)
        later_ns = int(made.times_ns[0]) - self.stamp_ns if len(made) else 0
        rotor = self._follow_rotor()
        vars(made).update(
            stamp_ns=self.stamp_ns + later_ns,
            wall_stamp_ns=self.wall_stamp_ns + later_ns,
            duration_ns=self.duration_ns - later_ns,
            _rotor=replace(rotor, begin_ns=rotor.begin_ns - later_ns),
        )
        return made

    def points(
        self, mount: Mount | None = None, *, motion: Motion | None = None, at_ns: int | None = None
    ) -> Points:
        """The returns as points in the frame of a robot, each with its time; `lidario.merge` joins several.

        ::

            cloud = scan.points(Mount(x=0.2, yaw=3.14), motion=Velocity(x=0.8, yaw=0.5))

        Args:
            mount: Where the lidar is on the robot; None for its origin.
            motion: How the robot moved during the revolution: a `Velocity` in its own frame, or a function of
                time that gives poses. Each point is moved to where the robot would have seen it at `at_ns`. None
                for a robot that stood still.
            at_ns: That instant, on the clock of `stamp_ns`; None for the end of the revolution.

        Raises:
            InvalidValue: `mount` is no `Mount`, `motion` is neither a `Velocity` nor a function, `at_ns` is no
                whole number, or the pose function did not return an array of shape (n, 3).
        """
        hit = self.valid
        times_ns = self.times_ns[hit]
        end_ns = self.stamp_ns + self.duration_ns if at_ns is None else nanoseconds(at_ns, "at_ns")
        return Points(
            place(self.xy()[hit], times_ns, Mount() if mount is None else mount, motion, end_ns),
            times_ns,
            None if self.intensities is None else self.intensities[hit],
            np.zeros(len(times_ns), np.uint8),
        )

    def to_dict(self) -> dict[str, Any]:
        """The scan as plain numbers and lists, for JSON: as `lidario scan --json` prints it.

        ::

            return scan.to_dict()  # of a request in FastAPI

        The keys are names of this class; ``units`` names the unit of each that has one. `angles` are radians
        counter-clockwise, `ranges` metres, with None where nothing came back: JSON has no NaN. `intensities` is
        None where the format carries none.
        """
        return plain_of(self, _PLAIN)

    def _taken(self, which: NDArray[Any]) -> Scan:
        """Some of the samples, or all in another order; each keeps its time."""
        made = replace(
            self,
            device_angles=read_only(self.device_angles[which]),
            device_distances=read_only(self.device_distances[which]),
            intensities=None if self.intensities is None else read_only(self.intensities[which]),
        )
        left_out = None if self._left_out is None else read_only(self._left_out[which])
        vars(made).update(_times_ns=read_only(self.times_ns[which]), _left_out=left_out)
        return made

    def _in_time_order(self) -> Scan:
        return self if self._measured is None else self._measured

    def _ordered_as_this(self, made: Any) -> Any:
        return made if self._measured is None else made.sorted()

    def _follow_rotor(self) -> Rotor:
        return rotor_of(self, self._gaps) if self._rotor is None else self._rotor

    def to_laserscan(
        self,
        beams: SupportsIndex | None = None,
        *,
        begin_deg: float | None = None,
        order: BeamOrder = "counter-clockwise",
        frame_id: str = "laser",
        range_min: float = 0.05,
        range_max: float | None = None,
        no_return: NoReturn = "inf",
        filtered: NoReturn = "nan",
        mount_yaw: float = 0.0,
        preset: Preset = "rep103",
    ) -> LaserScan:
        """Resample onto an even grid of angles, as the ROS message ``sensor_msgs/LaserScan`` needs it.

        ``stamp + i * time_increment`` is the time at which beam ``i`` was measured, for every ``i``, also with
        lost packets. The grid covers the circle from 0 to 2 pi, each beam in the middle of its step. In the
        default order `time_increment` is negative: the device turns clockwise, so the first beam of a
        counter-clockwise grid is the one measured last. `lidario.scans.beams` explains the choice.

        A revolution that does not begin at `seam` (a device that marks its own first packet; formats that correct
        the angle) moves the grid: `angle_min` then follows the begin of the revolution, and may differ from scan
        to scan; `lidario.LaserScans` puts all scans of a stream on one grid. `mount_yaw` rotates the grid too; it
        begins in [-pi, pi).

        Of a device that sees less than a turn (`field_of_view`), the grid covers what it sees, its beams are its
        samples, and where its rotor turns counter-clockwise `time_increment` is positive in either order.

        Args:
            beams: Number of equal steps around the circle; None for as many as the scan has samples, which
                varies from scan to scan.
            begin_deg: Device angle where the grid begins, degrees clockwise; None for where this revolution began.
                The beams between the two get the time of a revolution earlier or later.
            order: ``"counter-clockwise"``: `angle_increment` is positive and `time_increment` negative.
                ``"measured"``: the same beams in the order of measuring, `angle_increment` is negative and
                `time_increment` positive.
            frame_id: Name of the coordinate frame.
            range_min: Metres; nearer returns count as no return.
            range_max: Metres; farther returns count as no return. None: the message states `max_range` of this
                scan (40 m when the device does not say), and farther returns stay in it with their values. By the
                convention of the message its readers ignore these; none is lost here without being asked for.
            no_return: What a beam without a return becomes: ``"inf"``, ``"nan"`` or ``"zero"``.
            filtered: What a beam becomes that has no other samples than those that filters took out; as
                `no_return`. ``"nan"`` says that nothing is known there, ``"inf"`` that nothing is there.
            mount_yaw: Angle of the device's forward axis in the frame, radians counter-clockwise.
            preset: ``"rep103"``: the angle 0 is ahead. ``"vendor"``: it is behind, pi minus the device's angle, as
                the vendors' ROS 2 drivers publish it; for a robot description that was made for those.

        Raises:
            InvalidValue: `beams` is no whole number above 0 (also by default, for a scan without samples), `order`,
                `no_return`, `filtered` or `preset` is not one of the words, `frame_id` is no text, `mount_yaw` or
                `begin_deg` is not finite, or `range_min` and `range_max` are not a range.
        """
        options = BeamOptions(order, frame_id, range_min, range_max, no_return, filtered, mount_yaw, preset)
        return self._resampled(beams, None if begin_deg is None else finite(begin_deg, "begin_deg"), options)

    def _resampled(self, beams: SupportsIndex | None, begin_deg: float | None, options: BeamOptions) -> LaserScan:
        scan = self._in_time_order()
        rotor = scan._follow_rotor()  # noqa: SLF001 - another scan
        return resample(scan, rotor if begin_deg is None else rotor.beginning_at(begin_deg), options, beams)
