"""Scans and sectors made by hand: for tests of what a program does with them, without any lidar."""

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidario import InvalidValue, Scan, Sector
from lidario.basics.arguments import MODERATE, finite, moderate, nanoseconds, parts_of, shown, whole

_Columns: TypeAlias = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8] | None]

ROUNDING_DEG = 1e-3
_STAMP_NS = 1_000_000_000
_WALL_STAMP_NS = 1_700_000_000_000_000_000


def make_scan(
    angles: ArrayLike,
    ranges: ArrayLike,
    *,
    intensities: ArrayLike | None = None,
    rpm: float = 600.0,
    stamp_ns: int = _STAMP_NS,
    wall_stamp_ns: int = _WALL_STAMP_NS,
    seq: int = 0,
    dropped_before: int = 0,
    lost_packets: int = 0,
    mode: str = "made",
    max_range: float = 0.0,
) -> Scan:
    """A scan with these samples.

    ::

        scan = make_scan([-0.1, 0.0, 0.1], [1.2, 0.4, 1.3])
        assert scan.nearest().range == pytest.approx(0.4)

        empty = make_scan(np.linspace(-np.pi, np.pi, 360, endpoint=False), np.nan)

    The samples are put into the order in which a lidar measures them: clockwise, beginning ahead. So
    ``scan.ranges`` has another order than `ranges`, unless that is so ordered; ``scan.sorted()`` has ascending
    angles.

    Args:
        angles: Radians counter-clockwise, 0 ahead; shape (n,).
        ranges: Metres; NaN or infinite where nothing comes back; shape (n,), or one number for all.
        intensities: 0 to 255; shape (n,), or one number for all; None for a lidar that tells none.
        rpm: Revolutions a minute; the samples divide the time of one revolution evenly.
        stamp_ns: When the first sample was measured.
        wall_stamp_ns: The same since the Unix epoch.
        seq: As in `Scan`, and so are the following ones.
        dropped_before: Scans that the reader missed before.
        lost_packets: How many packets are missing.
        mode: Name of the scan mode.
        max_range: Metres; 0 for a device that does not say.

    Raises:
        InvalidValue: The shapes do not fit together, an angle is not finite, a range is negative, an intensity is
            not from 0 to 255, `rpm` is not positive, or a stamp is no number of nanoseconds.
    """
    samples = _samples(angles, ranges, intensities, rpm)
    seq, max_range = whole(seq, "seq"), moderate(max_range, "max_range")
    stamp_ns, wall_stamp_ns = nanoseconds(stamp_ns, "stamp_ns"), nanoseconds(wall_stamp_ns, "wall_stamp_ns")
    order = np.argsort(samples[0], kind="stable")
    duration_ns = round(60e9 / rpm)
    return Scan(
        *_ordered(samples, order),
        stamp_ns=stamp_ns,
        wall_stamp_ns=wall_stamp_ns,
        time_increment_ns=duration_ns // max(1, len(order)),
        duration_ns=duration_ns,
        rpm=rpm,
        seq=seq,
        dropped_before=dropped_before,
        lost_packets=lost_packets,
        mode=mode,
        max_range=max_range,
    )


def make_sector(
    angles: ArrayLike,
    ranges: ArrayLike,
    *,
    degrees: float = 45.0,
    index: int | None = None,
    intensities: ArrayLike | None = None,
    rpm: float = 600.0,
    stamp_ns: int | None = None,
    wall_stamp_ns: int | None = None,
    seq: int = 0,
    dropped_before: int = 0,
    lost_packets: int = 0,
    mode: str = "made",
    max_range: float = 0.0,
) -> Sector:
    """A sector with these samples.

    ::

        sector = make_sector([-0.1, -0.2, -0.3], [1.2, 0.4, 1.3])
        assert sector.index == 0
        assert sector.nearest().range == pytest.approx(0.4)

    The samples are put into the order in which a lidar measures them: clockwise, from the first one behind the
    widest gap. They need not end where the sector does: samples that stand on both sides of straight ahead make a
    sector too.

    Args:
        angles: Radians counter-clockwise, 0 ahead; shape (n,). The samples may not spread over more than `degrees`.
        ranges: As for `make_scan`.
        degrees: Size of the sector: 360 degrees must be a multiple of it, and it must not be less than 5.
        index: Which part of the revolution it is, from 0; None for the one that the middle of the samples is in,
            where a revolution begins ahead.
        intensities: As for `make_scan`.
        rpm: Revolutions a minute; the samples divide the time of the sector evenly.
        stamp_ns: When the first sample was measured; None for the time at which sector `index` of revolution `seq`
            begins, one second after the clock began.
        wall_stamp_ns: The same since the Unix epoch.
        seq: Number of the revolution.
        dropped_before: Sectors that the reader missed before.
        lost_packets: How many packets are missing.
        mode: Name of the scan mode.
        max_range: Metres; 0 for a device that does not say.

    Raises:
        InvalidValue: As for `make_scan`; or the samples spread over more than `degrees`, `degrees` is no such size,
            or the revolution has no sector `index`.
    """
    samples = _samples(angles, ranges, intensities, rpm)
    clockwise = samples[0]
    degrees, seq = finite(degrees, "the size of a sector"), whole(seq, "seq")
    max_range = moderate(max_range, "max_range")
    parts = parts_of(degrees)
    order = np.argsort(clockwise, kind="stable")
    middle = 0.0
    if order.size:
        ordered = clockwise[order].astype(np.float64)
        gaps = (ordered - np.roll(ordered, 1)) % 360.0
        # One sample has a gap of the whole circle to itself.
        first = int(np.argmax(gaps)) if order.size > 1 else 0
        order = np.roll(order, -first)
        spread = (float(clockwise[order[-1]]) - float(clockwise[order[0]])) % 360.0
        if spread > degrees + ROUNDING_DEG:
            raise InvalidValue(f"the samples of a sector of {degrees:g} degrees spread over {spread:.1f}")
        middle = (float(clockwise[order[0]]) + spread / 2) % 360.0
    index = min(int(middle / degrees), parts - 1) if index is None else whole(index, "index")
    if not 0 <= index < parts:
        raise InvalidValue(
            f"a revolution has sectors 0 to {parts - 1} of {degrees:g} degrees, and no sector {shown(index)}"
        )
    duration_ns = round(60e9 / rpm / parts)
    since_ns = (seq * parts + index) * duration_ns
    return Sector(
        *_ordered(samples, order),
        stamp_ns=_STAMP_NS + since_ns if stamp_ns is None else nanoseconds(stamp_ns, "stamp_ns"),
        wall_stamp_ns=(
            _WALL_STAMP_NS + since_ns if wall_stamp_ns is None else nanoseconds(wall_stamp_ns, "wall_stamp_ns")
        ),
        time_increment_ns=duration_ns // max(1, len(clockwise)),
        duration_ns=duration_ns,
        rpm=rpm,
        seq=seq,
        index=index,
        degrees=degrees,
        dropped_before=dropped_before,
        lost_packets=lost_packets,
        mode=mode,
        max_range=max_range,
    )


def _samples(angles: ArrayLike, ranges: ArrayLike, intensities: ArrayLike | None, rpm: float) -> _Columns:
    """Clockwise degrees, millimetres and intensities of samples, as the device tells them."""
    given = np.atleast_1d(_numbers(angles, "angles"))
    metres = _numbers(ranges, "ranges")
    strengths = None if intensities is None else _numbers(intensities, "intensities")
    try:
        metres = np.broadcast_to(metres, given.shape)
        strengths = None if strengths is None else np.broadcast_to(strengths, given.shape)
    except ValueError:
        raise InvalidValue(
            f"there are {given.size} angles; ranges and intensities must be as many, or one number"
        ) from None
    if given.ndim != 1 or not (np.abs(given) <= MODERATE).all():
        raise InvalidValue("angles are finite radians, in an array of shape (n,)")
    if (metres < 0).any():
        raise InvalidValue("ranges are metres from 0 on, or NaN where nothing comes back")
    with np.errstate(over="ignore"):
        millimetres = (metres * 1000.0).astype(np.float32)
    if strengths is not None and (not (strengths >= 0).all() or not (strengths <= 255).all()):
        raise InvalidValue("intensities are numbers from 0 to 255")
    if not moderate(rpm, "rpm") >= 1 / MODERATE:
        raise InvalidValue(f"rpm is a positive number of revolutions a minute, not {rpm}")
    degrees = (-np.degrees(given)) % 360.0
    clockwise = degrees.astype(np.float32)
    clockwise[clockwise >= 360.0] = 0.0  # just below 360, single precision rounds up
    # Farther than single precision reaches is infinite too: nothing comes back.
    millimetres[~np.isfinite(millimetres)] = 0.0
    return clockwise, millimetres, None if strengths is None else strengths.astype(np.uint8)


def _numbers(values: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValue(f"{what} are numbers, not {shown(values)}") from None


def _ordered(samples: _Columns, order: NDArray[np.intp]) -> _Columns:
    """The samples in this order; read-only, as the arrays of every scan are."""
    angles, distances, strengths = samples
    ordered = angles[order], distances[order], None if strengths is None else strengths[order]
    for each in ordered:
        if each is not None:
            each.setflags(write=False)
    return ordered
