"""The streams of a session, as a user begins them: full revolutions, parts of them, a single scan."""

from collections.abc import Callable, Iterable
from typing import Any

from lidario.basics.arguments import callable_of, parts_of, shown
from lidario.config.read import LidarConfig
from lidario.errors import InvalidValue, LocalProtocolError
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.session.questions import Questions
from lidario.session.streaming.stream import ScanStream, SectorStream

DEFAULT_DEGREES = 45.0
"""Size of a sector, where a program names none."""


class Streams(Questions):
    """What `Lidar` hands out; the base of it."""

    config: LidarConfig

    def scans(
        self,
        mode: str | int | None = None,
        *,
        depth: int = 1,
        force: bool = False,
        filters: Iterable[Callable[[Scan], Scan]] = (),
    ) -> ScanStream:
        """A stream of full revolutions, for ``async for``; several may run side by side.

        Args:
            mode: Name or id of a scan mode; None for the one that runs, or else that of the settings, or else the
                device's typical one.
            depth: Scans kept for a reader that falls behind; the oldest beyond that are dropped and counted.
            force: Ask the device to measure even when the motor is not up to speed.
            filters: Each scan passes them, in this order, when it is read; `lidario.filters` has some. What one
                of them raises, the reader gets.

        Raises:
            InvalidValue: `depth` is no number of scans, or `filters` are no list of functions.
        """
        return ScanStream(self._scanner, mode, depth, force, self._check_open, 0, self._with_own(filters))

    def sectors(
        self,
        degrees: float = DEFAULT_DEGREES,
        mode: str | int | None = None,
        *,
        depth: int | None = None,
        force: bool = False,
        filters: Iterable[Callable[[Sector], Sector]] = (),
    ) -> SectorStream:
        """A stream of parts of revolutions, each as soon as it is measured, for ``async for``.

        For what must be known before the revolution is whole, such as an obstacle. Streams of scans and of sectors,
        also of different sizes, may run side by side.

        Args:
            degrees: Size of a sector: 360 degrees must be a multiple of it, and it must not be less than 5.
            mode: As for `scans`.
            depth: Sectors kept for a reader that falls behind; the oldest beyond that are dropped and counted. None
                for those of one revolution.
            force: As for `scans`.
            filters: As for `scans`; each sees one sector at a time.

        Raises:
            InvalidValue: `degrees` is no such size, `depth` is no number of sectors, or `filters` are none.
        """
        parts = parts_of(degrees)
        kept = parts if depth is None else depth
        return SectorStream(self._scanner, mode, kept, force, self._check_open, parts, self._with_own(filters))

    async def scan(self, mode: str | int | None = None) -> Scan:
        """One full revolution. Laser and motor stop a second later, unless another stream was begun by then.

        Cancelling ends the waiting; laser and motor stop as after a scan.

        Args:
            mode: As for `scans`.

        Raises:
            StreamFailed: No scan came; the session goes on.
            DeviceFault: The device has stopped to protect itself, and a reset did not help; the session goes on.
            LocalProtocolError: Another task called `stop` before the scan was complete.
        """
        stream = self.scans(mode)
        try:
            return await anext(stream)
        except StopAsyncIteration:
            raise LocalProtocolError("another task stopped the lidar before the scan was complete") from None
        finally:
            stream.release()

    def _with_own(self, filters: object) -> tuple[Callable[[Any], Any], ...]:
        """The filters of the settings, then those that a user gave, in their order."""
        try:
            found: tuple[object, ...] = tuple(filters)  # type: ignore[arg-type]
        except TypeError:
            text = f"filters are a list, as in filters=[ShadowsFilter()], not {shown(filters)}"
            raise InvalidValue(text) from None
        return (*self.config.filters, *(callable_of(each, "a filter") for each in found))
