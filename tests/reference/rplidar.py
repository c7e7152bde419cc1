"""Scalar reference decoder for the RPLIDAR measurement formats 0x81 to 0x86.

Angles are device angles: degrees, clockwise. They keep full precision; the vendor's own decoder rounds most
of them down to 1/64° and then to 90°/16384. Names carry the scale of what they hold: ``q6`` is 1/64,
``q2`` is 1/4, and so on.

Only clean streams are understood: `split` raises `ValueError` at the first packet that does not fit. What a
decoder should do about damage is not a question for a reference. Start angles of 360° and more are not looked
for, nor steps too large to be true.
"""

import zlib
from collections.abc import Sequence
from math import trunc

from tests.reference.samples import Sample, u16

STANDARD = 0x81
CAPSULE = 0x82
HQ = 0x83
ULTRA_CAPSULE = 0x84
DENSE_CAPSULE = 0x85
ULTRA_DENSE_CAPSULE = 0x86

PACKET_BYTES = {0x81: 5, 0x82: 84, 0x83: 781, 0x84: 132, 0x85: 84, 0x86: 170}
PACKET_SAMPLES = {0x81: 1, 0x82: 32, 0x83: 96, 0x84: 96, 0x85: 40, 0x86: 64}

# Formats whose packets carry only a start angle: decoding one takes the start angle of the next.
CAPSULE_TYPES = (0x82, 0x84, 0x85, 0x86)
START_OFFSET = {0x82: 2, 0x84: 2, 0x85: 2, 0x86: 8}


# ---------------------------------------------------------------------------------------------------- packets


def split(response_type: int, raw: bytes) -> list[bytes]:
    """Cut a clean stream into packets, verifying marks and checksum of each; an incomplete end is refused."""
    size = PACKET_BYTES[response_type]
    if len(raw) % size != 0:
        raise ValueError(f"{len(raw)} bytes are not a whole number of {size}-byte packets")
    packets = [raw[offset : offset + size] for offset in range(0, len(raw), size)]
    for number, packet in enumerate(packets):
        fault = _fault(response_type, packet)
        if fault is not None:
            raise ValueError(f"packet {number} of type {response_type:#x}: {fault}")
    return packets


def _fault(response_type: int, packet: bytes) -> str | None:
    if response_type == STANDARD:
        if (packet[0] & 1) == (packet[0] >> 1 & 1):
            return "start bit and its inverse are equal"
        if packet[1] & 1 != 1:
            return "check bit is 0"
        return None

    if response_type == HQ:
        if packet[0] != 0xA5:
            return "sync byte is not A5"
        if zlib.crc32(packet[:777] + b"\0\0\0") != _u32(packet, 777):
            return "wrong CRC"
        return None

    if packet[0] >> 4 != 0xA or packet[1] >> 4 != 0x5:
        return "sync nibbles are not A and 5"
    checksum = 0
    for byte in packet[2:]:
        checksum ^= byte
    if checksum != (packet[0] & 0x0F) | (packet[1] & 0x0F) << 4:
        return "wrong checksum"
    return None


def start_q6(response_type: int, packet: bytes) -> int:
    """Start angle of a capsule in 1/64°."""
    return u16(packet, START_OFFSET[response_type]) & 0x7FFF


def is_reset(response_type: int, packet: bytes) -> bool:
    """Whether the encoder was (re)started before this capsule, so that it does not continue the last one."""
    return u16(packet, START_OFFSET[response_type]) & 0x8000 != 0


# ---------------------------------------------------------------------------------------------------- samples


def decode(response_type: int, packets: Sequence[bytes]) -> list[Sample]:
    """Decode packets that follow each other on the wire without a gap.

    Of the capsule formats the last packet yields nothing, nor does one whose successor says that the encoder
    was reset. The smoothing of 0x86 begins anew with every call.
    """
    if response_type == STANDARD:
        return [_decode_81(number, packet) for number, packet in enumerate(packets)]
    if response_type == HQ:
        return [sample for number, packet in enumerate(packets) for sample in _decode_83(number, packet)]
    if response_type not in CAPSULE_TYPES:
        raise ValueError(f"unknown response type {response_type:#x}")

    samples: list[Sample] = []
    previous_q2 = 0  # 0x86 only: distance of the last sample that was put out
    for number in range(len(packets) - 1):
        packet, following = packets[number], packets[number + 1]
        if is_reset(response_type, following):
            continue
        if response_type == CAPSULE:
            samples += _decode_82(number, packet, following)
        elif response_type == ULTRA_CAPSULE:
            samples += _decode_84(number, packet, following)
        elif response_type == DENSE_CAPSULE:
            samples += _decode_85(number, packet, following)
        else:
            decoded, previous_q2 = _decode_86(number, packet, following, previous_q2)
            samples += decoded
    return samples


def _decode_81(number: int, packet: bytes) -> Sample:
    """5 bytes: quality and start bits, angle q6 above a check bit, distance q2."""
    angle_deg = (u16(packet, 1) >> 1) / 64
    distance_mm = u16(packet, 3) / 4
    return Sample(number, 0, angle_deg, wrap(angle_deg), distance_mm, packet[0] & 0xFC)


def _decode_83(number: int, packet: bytes) -> list[Sample]:
    """96 nodes of 8 bytes behind a time stamp: angle in 90°/16384, distance q2, quality, flag."""
    samples = []
    for index in range(96):
        offset = 9 + 8 * index
        angle_deg = u16(packet, offset) * 90 / 16384
        distance_mm = _u32(packet, offset + 2) / 4
        samples.append(Sample(number, index, angle_deg, wrap(angle_deg), distance_mm, packet[offset + 6]))
    return samples


def _decode_82(number: int, packet: bytes, following: bytes) -> list[Sample]:
    """16 cabins of 5 bytes, two samples each: a 14-bit distance in mm and a 6-bit angle offset in 1/8°."""
    samples = []
    for cabin in range(16):
        offset = 4 + 5 * cabin
        words = (u16(packet, offset), u16(packet, offset + 2))
        low_bits = (packet[offset + 4] & 0x0F, packet[offset + 4] >> 4)
        for half in (0, 1):
            index = 2 * cabin + half
            distance_mm = words[half] >> 2
            offset_q3 = low_bits[half] | (words[half] & 3) << 4
            raw_deg = _beam_deg(CAPSULE, packet, following, index)
            angle_deg = wrap(raw_deg - offset_q3 / 8)
            samples.append(Sample(number, index, raw_deg, angle_deg, float(distance_mm), None))
    return samples


def _decode_84(number: int, packet: bytes, following: bytes) -> list[Sample]:
    """32 cabins of 32 bits, three samples each: a 12-bit major distance and two 10-bit differences."""
    samples = []
    cabins = [_u32(packet, 4 + 4 * cabin) for cabin in range(32)]
    cabins.append(_u32(following, 4))  # the last cabin's second difference refers to the next packet
    for cabin in range(32):
        major1, level1 = _variable_bit_scale(cabins[cabin] & 0xFFF)
        major2, level2 = _variable_bit_scale(cabins[cabin + 1] & 0xFFF)
        predict1 = _signed10(cabins[cabin] >> 12 & 0x3FF)
        predict2 = _signed10(cabins[cabin] >> 22 & 0x3FF)
        base1 = major1
        if major1 == 0 and major2 != 0:
            base1, level1 = major2, level2

        invalid = (-512, 511)
        distances_mm = (
            major1,
            0 if predict1 in invalid else (predict1 << level1) + base1,
            0 if predict2 in invalid else (predict2 << level2) + major2,
        )
        for third, signed_mm in enumerate(distances_mm):
            index = 3 * cabin + third
            distance_mm = max(signed_mm, 0)
            raw_deg = _beam_deg(ULTRA_CAPSULE, packet, following, index)
            angle_deg = wrap(raw_deg - correction_deg(4 * distance_mm))
            samples.append(Sample(number, index, raw_deg, angle_deg, float(distance_mm), None))
    return samples


def _variable_bit_scale(coded: int) -> tuple[int, int]:
    """Distance in mm and the level (number of low bits given up) of a 12-bit major value."""
    if coded >= 3328:
        return 16384 + ((coded - 3328) << 4), 4
    if coded >= 1792:
        return 4096 + ((coded - 1792) << 3), 3
    if coded >= 1280:
        return 2048 + ((coded - 1280) << 2), 2
    if coded >= 512:
        return 512 + ((coded - 512) << 1), 1
    return coded, 0


def correction_deg(distance_q2: int) -> float:
    """How far behind the beam angle the target is of a model that triangulates; in the vendor's integer steps."""
    if distance_q2 < 200:
        radians_q16 = trunc(7.5 * 3.1415926535 * 65536 / 180)
    else:
        k2 = 98361 // distance_q2
        radians_q16 = trunc(8 * 3.1415926535 * 65536 / 180) - (k2 << 6) - k2**3 // 98304
    return trunc(radians_q16 * 180 / 3.14159265) / 65536


def _decode_85(number: int, packet: bytes, following: bytes) -> list[Sample]:
    """40 distances of 16 bits in mm."""
    samples = []
    for index in range(40):
        raw_deg = _beam_deg(DENSE_CAPSULE, packet, following, index)
        distance_mm = float(u16(packet, 4 + 2 * index))
        samples.append(Sample(number, index, raw_deg, wrap(raw_deg), distance_mm, None))
    return samples


def _decode_86(number: int, packet: bytes, following: bytes, previous_q2: int) -> tuple[list[Sample], int]:
    """32 cabins of 5 bytes, two samples of 20 bits each: scale, then distance and quality to match."""
    samples = []
    for cabin in range(32):
        offset = 10 + 5 * cabin
        high = packet[offset + 4]
        words = (u16(packet, offset) | (high & 0x0F) << 16, u16(packet, offset + 2) | (high >> 4) << 16)
        for half in (0, 1):
            index = 2 * cabin + half
            distance_mm, quality = _scaled_86(words[half])
            distance_q2 = 4 * distance_mm
            near = words[half] & 3 == 0
            if near and previous_q2 != 0 and abs(distance_q2 - previous_q2) <= 8:
                distance_q2 = (distance_q2 + previous_q2) >> 1
            previous_q2 = distance_q2
            raw_deg = _beam_deg(ULTRA_DENSE_CAPSULE, packet, following, index)
            samples.append(Sample(number, index, raw_deg, wrap(raw_deg), distance_q2 / 4, quality))
    return samples, previous_q2


def _scaled_86(word: int) -> tuple[int, int]:
    """Distance in mm and quality of a 20-bit word, before smoothing."""
    scale = word & 3
    if scale == 0:
        return 2 * (word >> 2 & 0x3FF), word >> 12
    if scale == 1:
        return 3 * (word >> 2 & 0x7FF) + 2046, word >> 13 << 1
    if scale == 2:
        return 4 * (word >> 2 & 0xFFF) + 8187, word >> 14 << 2
    return 5 * (word >> 2 & 0x1FFF) + 24567, word >> 15 << 3


# ---------------------------------------------------------------------------------------------------- helpers


def wrap(degrees: float) -> float:
    """The same direction as an angle from 0 up to, but never, 360."""
    wrapped = degrees % 360.0
    return 0.0 if wrapped >= 360.0 else wrapped  # the remainder of a tiny negative number rounds to 360


def _beam_deg(response_type: int, packet: bytes, following: bytes, index: int) -> float:
    """Beam angle of one sample: equal steps to the next start angle. One division, so rounded only once."""
    first_q6 = start_q6(response_type, packet)
    way_q6 = start_q6(response_type, following) - first_q6
    if way_q6 < 0:
        way_q6 += 360 * 64
    count = PACKET_SAMPLES[response_type]
    return (first_q6 * count + way_q6 * index) / (64 * count)


def _u32(data: bytes, offset: int) -> int:
    return int.from_bytes(data[offset : offset + 4], "little")


def _signed10(value: int) -> int:
    return value - 1024 if value >= 512 else value
