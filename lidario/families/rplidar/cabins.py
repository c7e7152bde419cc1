"""What is inside the cabins of the packed formats: distances squeezed into few bits.

All of it from the vendor's SDK 2.1.0 (handlers of the normal, ultra and ultra-dense capsules); the manual
describes none of it. Shapes are (packets, cabins) in and (packets, samples) out.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["UltraCabins", "express_cabins", "near_range_correction", "ultra_dense_cabins"]

_LEVELS: Final = ((3328, 16384, 4), (1792, 4096, 3), (1280, 2048, 2), (512, 512, 1), (0, 0, 0))
"""0x84's variable bit scale: (first code, distance of the first code in mm, shift), highest first."""

_NO_PREDICTION: Final = (-512, 511)
"""0x84: predictions that mean: no return."""

_NEAR_Q2: Final = 200
_NEAR_RAD_Q16: Final = int(7.5 * 3.1415926535 * 65536 / 180)
_FAR_RAD_Q16: Final = int(8 * 3.1415926535 * 65536 / 180)
_K1: Final = 98361

_STEP_Q2: Final = np.array([2, 3, 4, 5], np.int32) * 4
_OFFSET_Q2: Final = np.array([0, 2046, 8187, 24567], np.int32) * 4
_MASK: Final = np.array([0x3FF, 0x7FF, 0xFFF, 0x1FFF], np.int32)
_QUALITY_AT: Final = np.array([12, 13, 14, 15], np.int32)
_QUALITY_UP: Final = np.array([0, 1, 2, 3], np.int32)
"""0x86, by the scale in the two lowest bits: distance = offset + step * (the bits of the mask above those two);
the bits from there on are the quality, shifted up to eight."""

_SMOOTHED_Q2: Final = 8
"""0x86: at scale 0, a step of up to 2 mm from the sample before is halved."""


def express_cabins(
    words: NDArray[np.uint16], offsets: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """0x82: distances in mm and the degrees to subtract from the even steps, both (packets, 32).

    Args:
        words: (packets, 16, 2), distance in the upper 14 bits, upper 2 bits of the correction below.
        offsets: (packets, 16), the lower 4 bits of both corrections.
    """
    upper = (words & 3).astype(np.uint8) << 4
    lower = np.empty(words.shape, np.uint8)
    np.bitwise_and(offsets, 0xF, out=lower[..., 0])
    np.right_shift(offsets, 4, out=lower[..., 1])
    shape = (len(words), -1)
    return (words >> 2).astype(np.float32).reshape(shape), ((upper | lower) / 8.0).reshape(shape)


class UltraCabins:
    """0x84: one distance on a variable bit scale and two predicted from its neighbours, a cabin."""

    def __init__(self) -> None:
        codes = np.arange(4096, dtype=np.int32)
        self._base = np.zeros(4096, np.int32)
        self._level = np.zeros(4096, np.int32)
        for first, base, level in reversed(_LEVELS):
            above = codes >= first
            self._base[above] = base + (codes[above] - first << level)
            self._level[above] = level

    def distances(
        self, cabins: NDArray[np.uint32], follower: int, followed: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Distances in mm, (packets, 96).

        The last prediction of a packet leans on the first cabin of the next packet, so where that one is
        missing the sample has no distance.

        Args:
            cabins: (packets, 32).
            follower: First cabin of the packet behind the last one.
            followed: (packets,), whether the next packet really follows.
        """
        words = cabins.astype(np.int64)
        codes = words & 0xFFF
        next_codes = np.empty_like(codes)
        next_codes.reshape(-1)[:-1] = codes.reshape(-1)[1:]
        next_codes[-1, -1] = follower & 0xFFF
        major, level = self._base[codes], self._level[codes]
        next_major, next_level = self._base[next_codes], self._level[next_codes]
        lean = (major == 0) & (next_major != 0)
        result = np.empty((*cabins.shape, 3), np.int32)
        result[..., 0] = major
        result[..., 1] = _predicted(
            words >> 12, np.where(lean, next_level, level), np.where(lean, next_major, major)
        )
        result[..., 2] = _predicted(words >> 22, next_level, next_major)
        result[~followed, -1, 2] = 0
        result[~followed & (major[:, -1] == 0), -1, 1] = 0
        return np.maximum(result, 0).astype(np.float32).reshape(len(cabins), -1)


def _predicted(bits: NDArray[np.int64], level: NDArray[np.int32], base: NDArray[np.int32]) -> NDArray[np.int64]:
    """Ten signed bits, scaled like the distance they lean on; 0 where they say: no return."""
    value = ((bits & 0x3FF) ^ 0x200) - 0x200
    absent = (value == _NO_PREDICTION[0]) | (value == _NO_PREDICTION[1])
    return np.where(absent, 0, (value << level) + base)


def near_range_correction(distance_mm: NDArray[np.float32]) -> NDArray[np.float64]:
    """0x84: degrees to subtract from the even steps, by the distance; same shape.

    The beam leaves beside the axis. The integer steps are the SDK's, so that both agree to the last bit.
    """
    return _corrections()[distance_mm.astype(np.int32)]


@cache
def _corrections() -> NDArray[np.float64]:
    """`near_range_correction` for every whole millimetre: looking up costs an eighth of computing."""
    q2 = np.arange(1 << 16) * 4
    k2 = _K1 // np.maximum(q2, 1)
    far = _FAR_RAD_Q16 - (k2 << 6) - k2**3 // 98304
    return np.trunc(np.where(q2 < _NEAR_Q2, _NEAR_RAD_Q16, far) * (180 / 3.14159265)) / 65536


def ultra_dense_cabins(
    low: NDArray[np.uint16], high: NDArray[np.uint8], last_q2: int
) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """0x86: distances in 1/4 mm and intensities, both flat, (packets * 64,).

    Args:
        low: (packets, 32, 2), the lower 16 bits of both samples.
        high: (packets, 32), their upper 4 bits each.
        last_q2: Distance of the sample before the first.
    """
    words = low.astype(np.int32)
    words[..., 0] |= (high & 0xF).astype(np.int32) << 16
    words[..., 1] |= (high >> 4).astype(np.int32) << 16
    words = words.reshape(-1)
    scale = words & 3
    distance = (words >> 2 & _MASK[scale]) * _STEP_Q2[scale] + _OFFSET_Q2[scale]
    intensity = words >> _QUALITY_AT[scale] << _QUALITY_UP[scale]
    return _smoothed(distance, scale == 0, last_q2), intensity.astype(np.uint8)


def _smoothed(raw: NDArray[np.int32], fine: NDArray[np.bool_], last: int) -> NDArray[np.int32]:
    """Each fine distance averaged with the result before it, where the two are within 2 mm.

    A recursion, solved for all samples at once: assume the results, compute them again from that, and go on with
    those whose predecessor changed. Each round settles at least one more sample of a chain, and halving makes
    chains short. Smoothing moves a sample by 1 mm at most, so pairs more than 4 mm apart are never concerned.
    """
    result = raw.copy()
    before = np.concatenate((np.array([last], np.int32), raw[:-1]))
    unsettled = np.flatnonzero(fine & (np.abs(raw - before) <= 2 * _SMOOTHED_Q2))
    while len(unsettled):
        own, earlier = raw[unsettled], result[unsettled - 1]
        if unsettled[0] == 0:
            earlier[0] = last
        near = (earlier != 0) & (np.abs(own - earlier) <= _SMOOTHED_Q2)
        again = np.where(near, (own + earlier) >> 1, own)
        successors = unsettled[again != result[unsettled]] + 1
        result[unsettled] = again
        successors = successors[successors < len(raw)]
        unsettled = successors[fine[successors]]
    return result
