"""All scans of one stream as LaserScan messages on one grid: as many beams in each, at the same angles.

slam_toolbox takes the number of beams and their angles from the first message that it gets, and refuses every
message with another number. The samples of a revolution vary, and where a lidar marks its own begin, or corrects
angles, so does the angle where a revolution begins. So a topic and a file have one grid, and it never changes.

**Where the grid comes from.** Not from the first scan: while a motor spins up, there are many more samples in a
revolution, and many beams of such a grid would be empty ever after. The first scans wait until one has no fewer
samples in a revolution than the one before: then the motor has its speed. They come out in their order, all on the
grid of the last one.
"""

from collections.abc import Iterator
from typing import Final, SupportsIndex

from lidario.scans.beams import BeamOptions, BeamOrder, NoReturn, Preset, beam_count
from lidario.scans.laserscan import LaserScan
from lidario.scans.rotor import Rotor
from lidario.scans.scan import Scan

MOST_WAITING: Final = 50
"""Scans that wait at most. By chance, so many in turn never become shorter; their memory is some megabytes."""


class LaserScans:
    """Turns the scans of one stream into messages on one grid.

    ::

        messages = LaserScans(frame_id="laser")
        async for scan in lidar.scans():
            for message in messages.take(scan):
                send(message.to_cdr())

    Args:
        beams: Beams of each message; then no scan waits. None for as many as a revolution has samples once the
            motor has its speed.

    The other arguments, and the errors, are those of `Scan.to_laserscan`.
    """

    def __init__(
        self,
        *,
        beams: SupportsIndex | None = None,
        order: BeamOrder = "counter-clockwise",
        frame_id: str = "laser",
        range_min: float = 0.05,
        range_max: float | None = None,
        no_return: NoReturn = "inf",
        filtered: NoReturn = "nan",
        mount_yaw: float = 0.0,
        preset: Preset = "rep103",
    ) -> None:
        self._options = BeamOptions(order, frame_id, range_min, range_max, no_return, filtered, mount_yaw, preset)
        self.frame_id: str = frame_id
        self.preset: Preset = preset
        self._beams = None if beams is None else beam_count(beams)
        self._begin_deg: float | None = None
        self._waiting: list[Scan] = []

    def __repr__(self) -> str:
        return f"<LaserScans: {'no grid yet' if self._begin_deg is None else f'{self._beams} beams'}>"

    @property
    def beams(self) -> int | None:
        """Beams of each message; None as long as that is not known."""
        return self._beams

    def take(self, scan: Scan) -> Iterator[tuple[Scan, LaserScan]]:
        """The messages that are ready, each with its scan: none as long as scans wait, then of all that waited.

        A scan without samples gives none.
        """
        if not len(scan):
            return
        self._waiting.append(scan)
        if self._begin_deg is not None or self._beams is not None or self._is_settled():
            yield from self.rest()

    def rest(self) -> Iterator[tuple[Scan, LaserScan]]:
        """The messages of the scans that wait, where a stream ends before the motor ran evenly."""
        waiting, self._waiting = self._waiting, []
        if waiting and self._begin_deg is None:
            self._begin_deg = rotor_in_time(waiting[-1]).begin_deg
            if self._beams is None:
                self._beams = beam_count(_samples_of_turn(waiting[-1]))
        for scan in waiting:
            yield scan, scan._resampled(self._beams, self._begin_deg, self._options)  # noqa: SLF001 - checked here

    def _is_settled(self) -> bool:
        if len(self._waiting) < 2:
            return False
        earlier, later = (_samples_of_turn(scan) for scan in self._waiting[-2:])
        return later >= earlier or len(self._waiting) >= MOST_WAITING


def rotor_in_time(scan: Scan) -> Rotor:
    """How the rotor turned during a scan."""
    return scan._in_time_order()._follow_rotor()  # noqa: SLF001 - of use in this room alone


def _samples_of_turn(scan: Scan) -> int:
    """How many samples a full revolution had, or what of it the device sees; those counted that are missing."""
    rotor, sample_ns = rotor_in_time(scan), scan.time_increment_ns
    seen_ns = rotor.period_ns * abs(rotor.field_deg) / 360.0
    return max(1, round(seen_ns / sample_ns)) if sample_ns > 0 else len(scan)
