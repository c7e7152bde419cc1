"""Point clouds of the relatives of the 4ROS: wider samples, other units, and an angle that depends on the distance.

The packet is the same but for its samples (the vendor's SDK 1.2.20, `DriverInterface.h` and `CYdLidar.cpp`):

* 2 bytes: the distance word;
* 3 bytes: a byte of intensity, then the distance word. Its low two bits are flags (sunlight, glass), or bits 8 and
  9 of the intensity, and no distance. In the check value the byte counts as a word of its own, so the XOR over the
  words of the packet is not 0: nothing is aligned behind the first sample;
* 4 bytes: a word of intensity, the distance word.

The word counts millimetres, halves or quarters of one. Models that triangulate see with a lens beside the laser: to
the angle of the beam they add atan(21.8 (155.3 - d) / (155.3 d)), d in mm, and nothing where nothing came back. So
neighbours may change places, and a sample may leave the span of its packet: revolutions are divided by the beam.

Intensities of 10 and 16 bits are divided so that they fit in eight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import Output, write_degrees
from lidario.families.spans import Arcs, Heads
from lidario.families.ydlidar.decode import PointCloudDecoder
from lidario.families.ydlidar.formats import FULL_TURN_Q6, HEADER_SIZE, MOST_SAMPLES, PointCloud
from lidario.wire.blocks import Block
from lidario.wire.envelope import xor_bytes
from lidario.wire.events import Packets


class PointCloud3(PointCloud):
    """Samples of three bytes."""

    response_type = 0xA6
    sample_size = 3
    shortest = HEADER_SIZE + 3
    longest = HEADER_SIZE + 3 * MOST_SAMPLES

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        """As `StreamFormat.intact`: of the words in the head, the intensities and the distances."""
        packet = data[at : at + size]
        low = xor_bytes(packet[0:10:2]) ^ xor_bytes(packet[10::3]) ^ xor_bytes(packet[11::3])
        return not low and xor_bytes(packet[1:10:2]) == xor_bytes(packet[12::3])

    def _intact_many(self, data: bytearray, at: int, blocks: Sequence[Block], count: int) -> int:  # noqa: ARG002
        # Nothing is aligned: as one array they would take as long.
        return self._intact_few(data, at, blocks)


class PointCloud4(PointCloud):
    """Samples of four bytes."""

    response_type = 0xA7
    sample_size = 4
    shortest = HEADER_SIZE + 4
    longest = HEADER_SIZE + 4 * MOST_SAMPLES


FORMATS: Final = (PointCloud, PointCloud3, PointCloud4)
"""By the bytes of a sample."""


@dataclass(frozen=True, slots=True)
class Kind:
    """How the samples of some models are to be read.

    Attributes:
        response_type: Number of this kind in scan modes and recordings. On the wire it is always 0x81; all others
            are our own.
        wire: The format of the packets.
        unit: The distance word counts so many parts of a millimetre.
        flags: Whether its low two bits are none of the distance.
        bits: Of the intensity; 0 where there is none.
        triangle: Whether the angle depends on the distance.
        speed_base: Tenths of Hz that the speed 0 stands for.
    """

    response_type: int
    wire: type[PointCloud] = PointCloud
    unit: int = 4
    flags: bool = False
    bits: int = 0
    triangle: bool = True
    speed_base: int = 0

    def decoder(self) -> PointCloudDecoder:
        """A fresh decoder."""
        return PointCloudDecoder() if self is KINDS["tg"] else CloudDecoder(self)


KINDS: Final = {
    "tg": Kind(PointCloud.response_type, unit=1, triangle=False, speed_base=30),
    "x": Kind(0xA1),
    "x-flags": Kind(0xA2, flags=True),
    "octave": Kind(0xA3, unit=2),
    "g2": Kind(0xA4, PointCloud3, flags=True, bits=10),
    "s4b": Kind(0xA5, PointCloud3, flags=True, bits=8),
    "tmini": Kind(PointCloud3.response_type, PointCloud3, flags=True, bits=8, triangle=False),
    "sh": Kind(PointCloud4.response_type, PointCloud4, unit=1, bits=16, triangle=False),
}
"""Every kind; the first is the 4ROS's."""


class CloudDecoder(PointCloudDecoder):
    """Decodes the packets of one stream of any kind."""

    def __init__(self, kind: Kind) -> None:
        super().__init__()
        self.speed_base: int = kind.speed_base
        self.has_intensity: bool = bool(kind.bits)
        self._kind = kind

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002 - each packet tells its own
        kind = self._kind
        raw = _sample_bytes(heads.read.packets, kind.wire.sample_size, len(output.angle))
        word = raw[:, -2] | raw[:, -1].astype(np.uint16) << 8
        np.divide(word & 0xFFFC if kind.flags else word, kind.unit, out=output.distance, casting="unsafe")
        beam = _beams(heads)
        if kind.triangle:
            d = output.distance.astype(np.float64)
            with np.errstate(divide="ignore"):
                beam += np.where(d > 0, np.degrees(np.arctan(21.8 * (155.3 - d) / (155.3 * d))), 0.0)
        write_degrees(beam, output.angle)
        if kind.bits == 10:
            output.intensity[...] = (raw[:, 0] | (word & 3) << 8) >> 2
        elif kind.bits:
            # Of 16 bits the upper eight.
            output.intensity[...] = raw[:, -3]


def _sample_bytes(packets: Packets, sample_size: int, total: int) -> NDArray[np.uint8]:
    """The bytes of all samples, shape (samples, bytes of one)."""
    data, found, at, place = np.frombuffer(packets.data, np.uint8), np.empty((total, sample_size), np.uint8), 0, 0
    for size, count in packets.blocks:
        rows = data[at : at + size * count].reshape(count, size)[:, HEADER_SIZE:]
        end = place + rows.size // sample_size
        found[place:end].reshape(rows.shape)[...] = rows
        at, place = at + size * count, end
    return found


def _beams(heads: Heads) -> NDArray[np.float64]:
    """Where the rotor stood at each sample, degrees in [0, 720)."""
    counts = np.asarray(heads.counts)
    steps = np.maximum(counts - 1, 1)
    order = np.arange(int(counts.sum())) - np.repeat(np.add.accumulate(counts) - counts, counts)
    units = np.repeat(np.asarray(heads.way), counts) * order + np.repeat(heads.first * steps, counts)
    beams: NDArray[np.float64] = units / np.repeat(64.0 * steps, counts)
    beams[beams >= FULL_TURN_Q6 / 64] -= 360.0
    return beams
