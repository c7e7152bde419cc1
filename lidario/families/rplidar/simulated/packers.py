"""The six measurement formats, written as the device writes them.

These are the decoders' inverse, made from the documents alone: nothing is shared with the host's parser.
Every function takes one packet or many (a leading axis of packets, each with as many samples as its format has)
and returns their bytes on end. A distance of 0 is no return. `new_stream` sets S in the first packet. What a field
cannot hold is a ValueError; but two formats, 0x84 and 0x86, cannot carry every distance.

Sources: response types 0x81 and 0x85 are in the S-series interface manual (SCAN and EXPRESS_SCAN); the
others are the packed structs of vendor SDK 2.1.0. Layouts, all little-endian, "q6" = 1/64 degree:

======  =====  ==============================================================================================
type    bytes  content
======  =====  ==============================================================================================
0x81    5      S, not S, quality (6 bits) | C=1, angle q6 (15 bits) | distance, quarter millimetres
0x82    84     head, start | 16 × (two words of 14 bits mm and 2 high offset bits, two low offset nibbles)
0x83    781    A5, u64 µs | 96 × (u16 angle q14 of 90°, u32 quarter mm, u8 quality, u8 flag) | CRC-32
0x84    132    head, start | 32 × u32: 12 bits major (variable bit scale), two signed 10-bit predictions
0x85    84     head, start | 40 × u16 mm
0x86    170    head, u32 µs, u16 status, start | 32 × (two u16 and a byte of high nibbles: two 20-bit words)
======  =====  ==============================================================================================

The head is two bytes, high nibbles A and 5, low nibbles the XOR of everything behind them, low nibble first.
In the start word bit 15 is S: the first packet of a stream, not the first of a revolution.
"""

import zlib
from typing import Final

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]

_STANDARD = np.dtype([("sync", "u1"), ("angle", "<u2"), ("distance", "<u2")])
_EXPRESS_CABIN = np.dtype([("word", "<u2", 2), ("offsets", "u1")])
_EXPRESS = np.dtype([("head", "u1", 2), ("start", "<u2"), ("cabin", _EXPRESS_CABIN, 16)])
_HQ_NODE = np.dtype([("angle", "<u2"), ("distance", "<u4"), ("quality", "u1"), ("flag", "u1")])
_HQ = np.dtype([("sync", "u1"), ("time", "<u8"), ("node", _HQ_NODE, 96), ("crc", "<u4")])
_ULTRA = np.dtype([("head", "u1", 2), ("start", "<u2"), ("cabin", "<u4", 32)])
_DENSE = np.dtype([("head", "u1", 2), ("start", "<u2"), ("distance", "<u2", 40)])
_ULTRA_DENSE_CABIN = np.dtype([("low", "<u2", 2), ("high", "u1")])
_ULTRA_DENSE = np.dtype(
    [("head", "u1", 2), ("time", "<u4"), ("status", "<u2"), ("start", "<u2"), ("cabin", _ULTRA_DENSE_CABIN, 32)]
)

# Variable bit scale (vendor SDK 2.1.0, ultra capsule unpacker): from which distance, from which code, shift.
_VBS_FROM: Final[Ints] = np.array([0, 512, 2048, 4096, 16384], dtype=np.int64)
_VBS_CODE: Final[Ints] = np.array([0, 512, 1280, 1792, 3328], dtype=np.int64)
_VBS_SHIFT: Final[Ints] = np.array([0, 1, 2, 3, 4], dtype=np.int64)
_VBS_MAX = 16384 + ((4095 - 3328) << 4)
_NO_PREDICTION = -512

# Scales of the ultra-dense format (vendor SDK 2.1.0): base and step in mm, bits of distance.
_SCALE_BASE: Final[Ints] = np.array([0, 2046, 8187, 24567], dtype=np.int64)
_SCALE_STEP: Final[Ints] = np.array([2, 3, 4, 5], dtype=np.int64)
_SCALE_BITS: Final[Ints] = np.array([10, 11, 12, 13], dtype=np.int64)
_SCALE_TOP: Final[Ints] = np.array([2046, 8187, 24567, 65522], dtype=np.int64)


def pack_standard(
    angle_q6: npt.ArrayLike, distance_q2: npt.ArrayLike, quality: npt.ArrayLike, start: npt.ArrayLike
) -> bytes:
    """Pack samples as response type 0x81; `start` marks the first sample of a revolution."""
    angle = np.atleast_1d(_whole(angle_q6, 0x7FFF, "angle"))
    nodes = np.empty(angle.shape, _STANDARD)
    nodes["sync"] = (_whole(quality, 0x3F, "quality") << 2) | np.where(start, 0b01, 0b10)
    nodes["angle"] = (angle << 1) | 1
    nodes["distance"] = _whole(distance_q2, 0xFFFF, "distance")
    return nodes.tobytes()


def pack_express(
    start_q6: npt.ArrayLike, distances_mm: npt.ArrayLike, offsets_q3: npt.ArrayLike = 0, *, new_stream: bool = False
) -> bytes:
    """Pack response type 0x82; `offsets_q3` is what the host subtracts from a sample's angle, in 1/8 degree."""
    mm = _whole(distances_mm, 0x3FFF, "distance").reshape(-1, 16, 2)
    offset = _whole(offsets_q3, 0x3F, "offset")
    offset = np.broadcast_to(offset.reshape(-1, 16, 2) if offset.ndim else offset, mm.shape)
    packets = np.zeros(len(mm), _EXPRESS)
    packets["start"] = _start(start_q6, new_stream)
    packets["cabin"]["word"] = (mm << 2) | (offset >> 4)
    packets["cabin"]["offsets"] = (offset[..., 0] & 15) | ((offset[..., 1] & 15) << 4)
    return _sealed(packets)


def pack_hq(
    angle_q14: npt.ArrayLike,
    distance_q2: npt.ArrayLike,
    quality: npt.ArrayLike,
    flag: npt.ArrayLike,
    *,
    time_us: npt.ArrayLike = 0,
) -> bytes:
    """Pack response type 0x83; bit 0 of `flag` marks the first sample of a revolution."""
    angle = _whole(angle_q14, 0xFFFF, "angle").reshape(-1, 96)
    packets = np.zeros(len(angle), _HQ)
    packets["sync"] = 0xA5
    packets["time"] = time_us
    packets["node"]["angle"] = angle
    packets["node"]["distance"] = _whole(distance_q2, 0xFFFF_FFFF, "distance").reshape(-1, 96)
    packets["node"]["quality"] = _whole(quality, 0xFF, "quality").reshape(-1, 96)
    packets["node"]["flag"] = _whole(flag, 0xFF, "flag").reshape(-1, 96)
    body = packets.tobytes()
    size = _HQ.itemsize
    # The device's CRC runs over the 777 bytes and the zeros that fill them up to a multiple of four.
    packets["crc"] = [zlib.crc32(body[at : at + size - 4] + b"\0\0\0") for at in range(0, len(body), size)]
    return packets.tobytes()


def pack_ultra(
    start_q6: npt.ArrayLike, distances_mm: npt.ArrayLike, next_mm: float = 0.0, *, new_stream: bool = False
) -> bytes:
    """Pack response type 0x84.

    A distance too far from its neighbours' for a ten-bit prediction, or beyond 28656 mm, becomes 0. The predictions
    of the last cabin rest on `next_mm`, the first distance of the packet that follows.
    """
    code, predictions = _ultra_cabins(distances_mm, next_mm)
    words = code | ((predictions[:, 0] & 0x3FF) << 12) | ((predictions[:, 1] & 0x3FF) << 22)
    packets = np.zeros(len(words) // 32, _ULTRA)
    packets["start"] = _start(start_q6, new_stream)
    packets["cabin"] = words.reshape(-1, 32)
    return _sealed(packets)


def pack_dense(start_q6: npt.ArrayLike, distances_mm: npt.ArrayLike, *, new_stream: bool = False) -> bytes:
    """Pack response type 0x85."""
    mm = _whole(distances_mm, 0xFFFF, "distance").reshape(-1, 40)
    packets = np.empty(len(mm), _DENSE)
    packets["start"] = _start(start_q6, new_stream)
    packets["distance"] = mm
    return _sealed(packets)


def pack_ultra_dense(
    start_q6: npt.ArrayLike,
    distances_mm: npt.ArrayLike,
    quality: npt.ArrayLike,
    *,
    time_us: npt.ArrayLike = 0,
    status: int = 0,
    new_stream: bool = False,
) -> bytes:
    """Pack response type 0x86: distances in steps of 2 to 5 mm, quality in steps of 1 to 8.

    A distance beyond 65522 becomes 0.
    """
    mm = np.asarray(distances_mm, dtype=np.float64)
    mm = np.where(mm > _SCALE_TOP[-1], 0.0, mm)
    scale = np.searchsorted(_SCALE_TOP, mm).astype(np.int64)
    steps = np.rint((mm - _SCALE_BASE[scale]) / _SCALE_STEP[scale]).astype(np.int64)
    steps = np.minimum(steps, (1 << _SCALE_BITS[scale]) - 1)
    strength = np.broadcast_to(_whole(quality, 0xFF, "quality"), mm.shape)
    word = scale | (steps << 2) | ((strength >> scale) << (12 + scale))
    pairs = word.reshape(-1, 32, 2)
    packets = np.zeros(len(pairs), _ULTRA_DENSE)
    packets["time"] = np.asarray(time_us, dtype=np.int64) & 0xFFFF_FFFF
    packets["status"] = status
    packets["start"] = _start(start_q6, new_stream)
    packets["cabin"]["low"] = pairs & 0xFFFF
    packets["cabin"]["high"] = (pairs[..., 0] >> 16) | ((pairs[..., 1] >> 16) << 4)
    return _sealed(packets)


def _ultra_cabins(distances_mm: npt.ArrayLike, next_mm: float) -> tuple[Ints, Ints]:
    """Codes (c,) and predictions (c, 2) of c cabins of three samples."""
    mm = np.rint(np.asarray(distances_mm, dtype=np.float64)).astype(np.int64).reshape(-1, 32 * 3)
    cabins = mm.reshape(-1, 3)
    majors = np.append(cabins[:, 0], round(next_mm))
    majors[majors > _VBS_MAX] = 0
    level = np.searchsorted(_VBS_FROM, majors, side="right") - 1
    half = (1 << _VBS_SHIFT[level]) >> 1
    code = np.minimum(_VBS_CODE[level] + ((majors - _VBS_FROM[level] + half) >> _VBS_SHIFT[level]), 4095)
    # Rounding up may reach the next level's first code, so the level is read from the code, as the host does.
    level = np.searchsorted(_VBS_CODE, code, side="right") - 1
    value = _VBS_FROM[level] + ((code - _VBS_CODE[level]) << _VBS_SHIFT[level])
    borrowed = (value[:-1] == 0) & (value[1:] != 0)
    base = np.stack([np.where(borrowed, value[1:], value[:-1]), value[1:]], axis=1)
    shift = np.stack([np.where(borrowed, level[1:], level[:-1]), level[1:]], axis=1)
    wanted = cabins[:, 1:]
    predictions = (wanted - base + ((1 << shift) >> 1)) >> shift
    decoded = (predictions << shift) + base
    carried = (wanted > 0) & (predictions > _NO_PREDICTION) & (predictions < 511) & (decoded > 0)
    return code[:-1], np.where(carried, predictions, _NO_PREDICTION)


def _whole(values: npt.ArrayLike, top: int, what: str) -> Ints:
    """Round to integers and refuse what its field cannot hold."""
    array = np.asarray(values)
    whole = array.astype(np.int64) if array.dtype.kind in "iub" else np.rint(array).astype(np.int64)
    if whole.size and (int(whole.max()) > top or int(whole.min()) < 0):
        raise ValueError(f"{what} out of range: {int(whole.min())}..{int(whole.max())} is not within 0..{top}")
    return whole


def _start(start_q6: npt.ArrayLike, new_stream: bool) -> Ints:
    """The start words of consecutive packets."""
    start = np.array(np.atleast_1d(_whole(start_q6, 0x7FFF, "start angle")))
    if new_stream:
        start[0] |= 0x8000
    return start


def _sealed(packets: npt.NDArray[np.void]) -> bytes:
    """Fill in the head: the two sync nibbles and the checksum of everything behind them."""
    raw = packets.view(np.uint8).reshape(len(packets), -1)
    # Columns of words halve the work: the XOR of words, folded, is the XOR of bytes.
    folded = np.bitwise_xor.reduce(raw.view("<u2")[:, 1:], axis=1)
    total = (folded ^ (folded >> 8)).astype(np.uint8)
    raw[:, 0] = 0xA0 | (total & 0x0F)
    raw[:, 1] = 0x50 | (total >> 4)
    return raw.tobytes()
