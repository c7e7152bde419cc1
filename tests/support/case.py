"""What a family tells the tests: its device, and how each stream is announced, cut and decoded; and the truth."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families import scripts
from lidario.families.base import Decoder
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat
from tests.reference import golden
from tests.reference.samples import Sample, revolutions


class Maker(NamedTuple):
    """What a family says of the device that stands for it.

    Attributes:
        tuned: Whether its scan frequency can be set, and it hears right behind a stop request: most of these tests
            rest on that. Others run with each that obeys.
    """

    make: Callable[..., Any]  # makes a simulated device by its name
    model: str  # the name of the one that is used where nothing else is said
    turn_s: float  # how long one of its revolutions takes
    obeys: bool  # whether it obeys requests, and so is asked, stopped and reset in most tests of sessions
    tuned: bool = True


@dataclass(frozen=True, eq=False)
class Case:
    """One golden stream, and all that is particular to its format.

    Attributes:
        name: Name of the golden file.
        response_type: Type byte of the descriptor.
        told: What the device has said of itself before, where a recording cannot be decoded without it.
        descriptor: What the device says before the first packet; empty where it announces nothing.
        make_format: A fresh packet format.
        make_decoder: A fresh decoder.
        request: The request that starts a stream of that format.
        sample_us: Microseconds a sample.
        split: Scalar: a clean stream into its packets.
        decode: Scalar: consecutive packets into samples.
        revolutions: Scalar: samples into whole turns.
        lookahead: Whether a packet is decoded only with the one behind it.
        contents: Packets with intact check values and any contents, by a generator of random numbers, the angles
            where they begin in 64ths of a degree, and whether these need not turn as a rotor does.
        even: Whether each sample takes `sample_us`; else the packets tell the speed that decides it.
        exact: Whether the vendor's program tells angles at full precision.
        seal: A packet of that many bytes with an intact check value: a few of the bytes change.
        intensity_bits: Of the qualities that the reference tells.
        layout: For the tests of the family: how samples lie in their bytes.
    """

    name: str
    response_type: int
    descriptor: bytes
    make_format: Callable[[], StreamFormat]
    make_decoder: Callable[[], Decoder]
    request: Callable[[StreamFormat], Request]
    sample_us: float
    split: Callable[[bytes], list[bytes]]
    decode: Callable[[Sequence[bytes]], Sequence[Sample]]
    lookahead: bool
    contents: Callable[["Case", np.random.Generator, NDArray[np.int64], bool], list[bytes]]
    seal: Callable[["Case", bytes], bytes]
    even: bool = True
    exact: bool = False
    told: bytes = b""
    revolutions: Callable[[Iterable[Sample]], Sequence[Sequence[Sample]]] = revolutions
    intensity_bits: int = 8
    layout: object = None

    @cached_property
    def truth(self) -> golden.Golden:
        """What the vendor's program made of it."""
        return golden.load(self.name)

    @cached_property
    def raw(self) -> bytes:
        """The golden bytes; of a stream with other records between its packets, the packets."""
        return self.truth.raw if self.descriptor else b"".join(self.packets)

    @cached_property
    def packets(self) -> tuple[bytes, ...]:
        """The golden packets."""
        return tuple(self.split(self.truth.raw))

    @cached_property
    def samples(self) -> tuple[Sample, ...]:
        """All samples, as the scalar reference decodes them."""
        return tuple(self.decode(self.packets))

    @cached_property
    def turns(self) -> tuple[tuple[Sample, ...], ...]:
        """The whole turns among them."""
        return tuple(map(tuple, self.revolutions(self.samples)))

    @cached_property
    def correction_deg(self) -> float:
        """How far an angle differs from its beam's at most: what the format corrects by the distance."""
        return max(abs((sample.angle_deg - sample.raw_deg + 180) % 360 - 180) for sample in self.samples)

    @cached_property
    def byte_ns(self) -> float:
        """How long a byte takes at the device's own pace."""
        return len(self.samples) * self.sample_us * 1e3 / len(self.raw)

    def intensities(self, samples: Sequence[Sample]) -> list[int] | None:
        """What a scan has of their qualities: the upper eight bits, where the format has more."""
        more = max(self.intensity_bits - 8, 0)
        found = [sample.quality >> more for sample in samples if sample.quality is not None]
        assert len(found) in (0, len(samples))
        return found or None


def of_a_talker(name: str, wire: Callable[[], StreamFormat], decoder: Callable[[], Decoder], **about: Any) -> Case:
    """The golden stream of a device that only talks, each packet of which is decoded by itself.

    The golden file says how long a sample takes. What else is particular to it is told as in `Case`.
    """
    sample_us = golden.load(name).sample_us
    assert sample_us is not None
    return Case(
        name=name,
        response_type=wire().response_type,
        descriptor=b"",
        make_format=wire,
        make_decoder=decoder,
        request=scripts.begin,
        sample_us=sample_us,
        exact=True,
        **{"lookahead": False, **about},
    )
