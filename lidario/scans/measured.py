"""What a scan and a part of one have in common: samples in the figures of the device, and in those of robots.

`lidario.scans.scan` tells the convention of angles.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import callable_of, shown
from lidario.errors import InvalidValue
from lidario.scans.rotor import Gaps, Rotor, times_of
from lidario.scans.samples import is_between, metres_of, nearest_return, radians_of, read_only

_RecordT = TypeVar("_RecordT", bound="MeasuredSamples")
_ValueT = TypeVar("_ValueT")

FloatArray = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Return:
    """Where one sample of a scan met something.

    Attributes:
        range: Metres; NaN where nothing came back.
        angle: Radians counter-clockwise, as in `Scan.angles`.
        index: Its place in the arrays of the scan.
    """

    range: float
    angle: float
    index: int


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredSamples:
    """Base of the records that hold samples. They tell what these fields mean.

    It has no slots: what is computed on first use is kept beside the fields.
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
    # Which samples filters took out; None for none.
    _left_out: NDArray[np.bool_] | None = field(default=None, init=False)
    _gaps: Gaps | None = field(default=None, init=False)  # where samples are missing; None where that is not known

    def __len__(self) -> int:
        return len(self.device_distances)

    def __reduce__(self) -> tuple[Any, ...]:
        # By itself a dataclass would leave the arrays of a loaded record writeable: numpy does not keep that.
        return _made_again, (
            type(self),
            {name: value for name, value in vars(self).items() if name not in _MADE_ON_USE},
        )

    def _kept(self, name: str, make: Callable[[], _ValueT]) -> _ValueT:
        """What is computed on first use, and kept beside the fields."""
        # With `functools.cached_property` it would have no text in `help`, and in Python 3.11 a lock, which a
        # process that is forked meanwhile would find taken for ever.
        kept = vars(self)
        if name not in kept:
            kept[name] = make()
        return cast("_ValueT", kept[name])

    @property
    def angles(self) -> FloatArray:
        """Radians, float32, counter-clockwise, in [-pi, pi]; 0 is the device's forward axis."""
        return self._kept("_angles", lambda: radians_of(self.device_angles))

    @property
    def ranges(self) -> FloatArray:
        """Metres, float32; NaN where nothing came back."""
        return self._kept("_ranges", lambda: metres_of(self.device_distances))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the samples with a return, shape (n,)."""
        return self.device_distances > 0

    @property
    def left_out(self) -> NDArray[np.bool_]:
        """Mask of the samples that filters took out, shape (n,); none is `valid`."""
        return read_only(np.zeros(len(self), np.bool_)) if self._left_out is None else self._left_out

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """When each sample was measured, on the clock of `stamp_ns`; int64, shape (n,).

        Where no packet is missing, sample ``i`` is at ``stamp_ns + i * time_increment_ns``. Otherwise the samples
        that are missing are counted too, as far as the angles tell how many they are.
        """
        return self._kept("_times_ns", lambda: read_only(self._offsets_ns() + self.stamp_ns))

    def directions(self) -> tuple[FloatArray, FloatArray]:
        """Cosine and sine of `angles`, each float32, shape (n,)."""
        return self._kept("_directions", lambda: (read_only(np.cos(self.angles)), read_only(np.sin(self.angles))))

    def xy(self) -> NDArray[np.float32]:
        """Cartesian points in metres, float32, shape (n, 2): x forward, y left; NaN rows without a return."""
        cos, sin = self.directions()
        return np.stack((self.ranges * cos, self.ranges * sin), axis=1)

    def nearest(self, between: tuple[float, float] | None = None) -> Return | None:
        """The nearest return, or None where nothing came back.

        ::

            ahead = scan.nearest(between=(-0.3, 0.3))
            if ahead and ahead.range < 0.5:
                stop()

        Args:
            between: Only from the first angle counter-clockwise to the second, radians of at most a turn;
                ``(-0.3, 0.3)`` is ahead, ``(3.0, -3.0)`` behind. None for all directions.

        Raises:
            InvalidValue: `between` is not two finite angles of at most a turn.
        """
        among = None if between is None else is_between(self.angles, between)
        index = nearest_return(self.device_distances, among)
        return None if index is None else self._return(index)

    def filtered(self, *filters: Callable[[Self], Self]) -> Self:
        """The same samples behind filters, one after the other; `lidario.filters` has some.

        What a filter takes out stays in its place, as a sample without a return, and `left_out` tells it from those
        where nothing came back. So the number of samples, their times, and what is missing are as before. ::

            clean = scan.filtered(BoxFilter(-0.3, 0.2, -0.2, 0.2), ShadowsFilter())

        Args:
            filters: Each is called with the scan, or sector, and returns one.

        Raises:
            InvalidValue: A filter cannot be called, or returns something else.
        """
        made = self
        for each in filters:
            callable_of(each, "a filter")
            found: object = each(made)
            if not isinstance(found, type(self)):
                raise InvalidValue(
                    f"the filter {shown(each)} must return a {type(self).__name__}, not {shown(found)}"
                )
            made = found
        return made

    def _return(self, index: int) -> Return:
        # The arrays of all samples are not made for one of them.
        one = slice(index, index + 1)
        return Return(
            metres_of(self.device_distances[one]).item(), radians_of(self.device_angles[one]).item(), index
        )

    def _offsets_ns(self) -> NDArray[np.int64]:
        """When each sample was measured, after the first one."""
        rotor = self._follow_rotor() if cast("Any", self).lost_packets else None
        if rotor is None:
            return np.arange(len(self), dtype=np.int64) * self.time_increment_ns
        return times_of(self.device_angles, self.time_increment_ns, rotor, self._gaps)

    def _follow_rotor(self) -> Rotor | None:
        """How the rotor turned meanwhile; None where that is not known, as here."""
        return None

    def _in_time_order(self) -> Self:
        return self

    def _ordered_as_this(self, made: Any) -> Any:
        return made


_MADE_ON_USE = ("_angles", "_ranges", "_directions")


def _made_again(kind: type[_RecordT], values: dict[str, Any]) -> _RecordT:
    """A record that was copied or pickled."""
    for value in values.values():
        if isinstance(value, np.ndarray):
            read_only(value)
    return made_of(kind, **values)


def made_of(kind: type[_RecordT], **values: object) -> _RecordT:
    """A record with these values of its fields, by their names.

    The constructor of a frozen class sets each field by a call of its own, which takes several times as long.
    """
    made = object.__new__(kind)
    vars(made).update(values)
    return made


def changed(record: _RecordT, **fields: Any) -> _RecordT:
    """The same record with other values of public fields; what is known of its samples goes with it."""
    given: Any = record
    made: _RecordT = replace(given, **fields)
    vars(made).update(_left_out=record._left_out, _gaps=record._gaps)  # noqa: SLF001 - of this module
    return made


def later(record: _RecordT, by_ns: int) -> _RecordT:
    """The same record, measured so much later."""
    fields: Any = record
    return changed(record, stamp_ns=fields.stamp_ns + by_ns, wall_stamp_ns=fields.wall_stamp_ns + by_ns)


_OF_TIME_AND_ANGLE = ("_angles", "_directions", "_gaps", "_times_ns", "_rotor")


def with_distances(
    record: _RecordT, change: Callable[[_RecordT], tuple[FloatArray, NDArray[np.bool_] | None]]
) -> _RecordT:
    """The same samples with other distances, measured at the same times and angles.

    `change` gives `device_distances` and the mask `left_out` of the samples in the order of measuring.
    """
    measured = record._in_time_order()  # noqa: SLF001 - of this module
    distances, left_out = change(measured)
    if distances is measured.device_distances and left_out is measured._left_out:  # noqa: SLF001
        return record
    given: Any = measured
    made: _RecordT = replace(given, device_distances=read_only(distances))
    vars(made).update({name: value for name, value in vars(measured).items() if name in _OF_TIME_AND_ANGLE})
    vars(made)["_left_out"] = None if left_out is None else read_only(left_out)
    return made if measured is record else record._ordered_as_this(made)  # noqa: SLF001
