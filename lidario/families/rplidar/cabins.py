"""Decodes the cabins of the packed formats, which hold distances in few bits.

All rules are from the vendor's SDK 2.1.0 (handlers of the normal, ultra and ultra-dense capsules). The manual
describes none of them.

The meaning of the bits is read from tables, which are made once from those rules. That costs a fraction of the
arithmetic.
"""

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

_LEVELS: Final = ((3328, 16384, 4), (1792, 4096, 3), (1280, 2048, 2), (512, 512, 1), (0, 0, 0))
"""0x84's variable bit scale: (first code, distance of the first code in mm, shift), highest first."""

_NO_PREDICTION: Final = (-512, 511)  # 0x84: predictions that mean no return
_NOTHING: Final = -(1 << 20)  # 0x84: a prediction so far below 0 that its sum with any distance is no distance

_NEAR_Q2: Final = 200
_NEAR_RAD_Q16: Final = int(7.5 * 3.1415926535 * 65536 / 180)
_FAR_RAD_Q16: Final = int(8 * 3.1415926535 * 65536 / 180)
_K1: Final = 98361

_SCALES: Final = ((8, 0, 0x3FF), (12, 8184, 0x7FF), (16, 32748, 0xFFF), (20, 98268, 0x1FFF))
"""0x86, by the scale in the two lowest bits: (step and offset in 1/4 mm, mask of the bits above those two). The
bits that are left are the quality, which is shifted up to eight bits."""

_SMOOTHED_Q2: Final = 8  # 0x86: at scale 0, a step of up to 2 mm from the sample before is halved

_FAR_Q2: Final = 100

_PAIR: Final = np.dtype({"names": ("words", "rest"), "formats": ("<u4", "u1"), "offsets": (0, 4)})
"""A cabin of 0x82 and 0x86: the words of two samples, and a byte with four more bits for each, lower half first."""

_NIBBLES: Final = np.array([(byte & 0xF, byte >> 4) for byte in range(256)], np.uint16)
_UPPER_NIBBLES: Final = np.array([(byte << 4 & 0xF0, byte & 0xF0) for byte in range(256)], np.uint8)
"""The bits of a byte for each of the two samples of its pair; in the second table, as the upper half of a byte."""


def _pairs(cabins: NDArray[np.uint16]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """The words of all samples, shape (n, 2), and the byte of each pair, shape (n,)."""
    pairs = cabins.ravel().view(_PAIR)
    words: NDArray[np.uint16] = np.ascontiguousarray(pairs["words"]).view("<u2")
    rest: NDArray[np.uint8] = pairs["rest"]
    return words.reshape(-1, 2), rest


def express_cabins(cabins: NDArray[np.uint16]) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """0x82: distances in mm and what to subtract from the even steps in 1/8 degrees, both flat, (packets * 32,).

    Args:
        cabins: (packets, 40), five bytes for two samples: distance in the upper 14 bits of each word, the upper 2
            bits of the correction below it, and its lower 4 bits in the byte of the pair.
    """
    words, lower = _pairs(cabins)
    eighths = words & np.uint16(3)
    eighths <<= 4
    eighths |= _NIBBLES.take(lower, axis=0)
    words >>= 2
    return words.ravel(), eighths.ravel()


@cache
def _ultra_tables() -> tuple[NDArray[np.int32], NDArray[np.intp], NDArray[np.int32]]:
    """0x84: tables of codes and predictions.

    The first two tables are for the 12 bits of a code: the distance in mm, and where its bit scale begins in the
    third table. The third is for scale and 10 bits of prediction: what to add to a distance, in mm.
    """
    codes = np.arange(4096)
    base, scale = np.zeros(len(codes), np.int32), np.zeros(len(codes), np.intp)
    value = (np.arange(1024) ^ 0x200) - 0x200
    predicted = np.empty((len(_LEVELS), 1024), np.int32)
    for first, distance, level in reversed(_LEVELS):
        above = codes >= first
        base[above] = distance + (codes[above] - first << level)
        scale[above] = level << 10
        predicted[level] = np.where(np.isin(value, _NO_PREDICTION), _NOTHING, value << level)
    return base, scale, predicted.ravel()


def ultra_cabins(
    cabins: NDArray[np.intp], follower: int | None, missing: NDArray[np.intp] | None
) -> NDArray[np.int32]:
    """0x84: each cabin has one distance on a variable bit scale, and two that are predicted from its neighbours.

    The last prediction of a packet needs the first cabin of the next packet. If that packet is missing, the sample
    has no distance.

    Args:
        cabins: (packets, 32).
        follower: The lower half of the first cabin of the packet behind the last one; None if there is none.
        missing: (packets,), samples missing behind each; None if none are.

    Returns:
        (packets, 96), in mm.
    """
    base, scale, predicted = _ultra_tables()
    words = cabins.ravel()
    codes = words & 0xFFF
    # The code that each of the three samples needs. First and second: that of the cabin itself; the second, if this
    # has no return, and the third: that of the next cabin.
    leant = np.empty((3, len(words)), np.intp)
    leant[:2] = codes
    leant[2, :-1] = codes[1:]
    leant[2, -1] = 0 if follower is None else follower & 0xFFF
    np.copyto(leant[1], leant[2], where=codes == 0)
    predictions = np.empty((2, len(words)), np.intp)
    np.right_shift(words, 12, out=predictions[0])
    np.right_shift(words, 22, out=predictions[1])
    predictions &= 0x3FF
    predictions += scale.take(leant[1:])
    sums = base.take(leant)
    sums[1:] += predicted.take(predictions)
    np.maximum(sums[1:], 0, out=sums[1:])
    distance = np.empty((len(cabins), 96), np.int32)
    # Three copies are twice as fast as one copy of the transposed sums.
    for of_cabin, here in zip(distance.reshape(-1, 3).T, sums, strict=True):
        of_cabin[...] = here
    if missing is not None or follower is None:
        cut_short = np.zeros(len(cabins), np.bool_) if missing is None else missing > 0
        cut_short[-1] |= follower is None
        distance[cut_short, -1] = 0
        distance[cut_short & (distance[:, -3] == 0), -2] = 0
    return distance


@cache
def near_range_corrections(units: float) -> NDArray[np.float32]:
    """0x84: corrections to subtract from the angles at equal steps, by the distance in whole mm; `units` a degree.

    The beam leaves the device beside its axis. The integer steps are those of the SDK, so that both agree to the
    last bit.
    """
    q2 = np.arange(1 << 16) * 4
    k2 = _K1 // np.maximum(q2, _NEAR_Q2)
    far = _FAR_RAD_Q16 - (k2 << 6) - k2**3 // 98304
    degrees = np.trunc(np.where(q2 < _NEAR_Q2, _NEAR_RAD_Q16, far) * (180 / 3.14159265)) / 65536
    return (degrees * units).astype(np.float32)


@cache
def _ultra_dense_tables() -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """0x86: tables by the lower 16 of the 20 bits of a sample: distance in 1/4 mm, lower bits of the intensity."""
    words = np.arange(1 << 16)
    distance, intensity = np.empty(len(words), np.int32), np.empty(len(words), np.uint8)
    for scale, (step, offset, mask) in enumerate(_SCALES):
        these = words & 3 == scale
        distance[these] = (words[these] >> 2 & mask) * step + offset
        intensity[these] = words[these] >> 12 + scale << scale
    return distance, intensity


def ultra_dense_cabins(
    cabins: NDArray[np.uint16], last_q2: int, missing: NDArray[np.intp] | None = None
) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """0x86: distances in 1/4 mm and intensities, both flat, (packets * 64,).

    Args:
        cabins: (packets, 80), five bytes for two samples: the lower 16 bits of each sample in its word, the upper
            4 in the byte of the pair.
        last_q2: Distance of the sample before the first, in 1/4 mm; 0 if that is missing.
        missing: (packets,), samples missing behind each; None if none are. Nothing is smoothed across a gap.
    """
    distances, intensities = _ultra_dense_tables()
    words, upper = _pairs(cabins)
    intensity = intensities.take(words)
    intensity |= _UPPER_NIBBLES.take(upper, axis=0)
    words = words.ravel()
    distance = distances.take(words)
    fine = words & 3 == 0
    if missing is not None:
        fine.reshape(len(cabins), -1)[1:, 0] &= missing[:-1] == 0
    return _smoothed(distance, fine, last_q2), intensity.ravel()


def _smoothed(raw: NDArray[np.int32], fine: NDArray[np.bool_], last: int) -> NDArray[np.int32]:
    """Average each fine distance with the result before it, if the two are within 2 mm.

    This is a recursion. It is solved for all samples at once: assume how far each was moved, and compute that again
    until nothing changes. Each round settles at least one more sample of a chain, and halving makes chains short.
    Smoothing moves a sample by 1 mm at most, so pairs more than 4 mm apart are never concerned.
    """
    before = np.empty_like(raw)
    before[0] = last
    before[1:] = raw[:-1]
    step = raw - before
    concerned = fine & (np.abs(step) <= 2 * _SMOOTHED_Q2)
    if not np.count_nonzero(concerned):
        return raw
    # For samples that are not concerned, a step that is too large for smoothing.
    small_step = np.where(concerned, step, _FAR_Q2).astype(np.int8)
    from_nothing = concerned & (before == 0)
    any_from_nothing = np.count_nonzero(from_nothing)
    moved, again = np.zeros((2, len(raw) + 1), np.int8)
    while True:
        away = moved[:-1] - small_step
        near = np.abs(away) <= _SMOOTHED_Q2
        if any_from_nothing:
            near &= ~from_nothing | (moved[:-1] != 0)
        away >>= 1
        np.multiply(away, near, out=again[1:])
        changed = again != moved
        moved, again = again, moved
        if not np.count_nonzero(changed):
            return raw + moved[1:]
