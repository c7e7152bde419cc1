"""What the benchmarks feed on: measurement streams of the simulated devices, all seven formats of them.

For work in memory all six formats of the first family run at the same 32000 samples and ten turns a second,
which no product does in each of them, so that figures can be compared: 3200 points a revolution. The line is
made fast enough to carry them. The seventh, the 4ROS's, runs at its own 20000 samples and seven turns.

For live work the devices are as they are sold: `RATES` names them. A `Recording` of one is bytes that can be
played for ever, since what repeats is a whole number of turns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from typing import Any

from lidario.basics.model import ScanMode
from lidario.families.base import Decoder, Stream
from lidario.families.registry import family_of_simulated
from lidario.families.rplidar import commands as rplidar_commands
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.simulated.device import PROFILES, Mode, Profile, SimulatedRplidar
from lidario.families.ydlidar import commands as ydlidar_commands
from lidario.families.ydlidar.decode import CloudDecoder
from lidario.families.ydlidar.formats import PointCloud
from lidario.wire.blocks import Block, join_blocks, packet_offsets
from lidario.wire.envelope import DESCRIPTOR_SIZE, Request
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, StreamFormat
from lidario.wire.link import Link

_STEP_NS = 10_000_000
_NAMES = {0x81: "nodes", 0x82: "express", 0x83: "HQ", 0x84: "ultra", 0x85: "dense", 0x86: "ultra-dense"}


@dataclass(frozen=True, slots=True)
class Kind:
    """One format, and how to get a stream of it.

    Attributes:
        name: For tables.
        family: Name of the family.
        mode: The scan mode, as the session would describe it.
        device: Makes a simulated device whose rotor needs no time to speed up.
        make_format: A fresh packet format.
        make_decoder: A fresh decoder.
        request: The request that starts a stream of that format.
    """

    name: str
    family: str
    mode: ScanMode
    device: Callable[[], Any]
    make_format: Callable[[], StreamFormat]
    make_decoder: Callable[[], Decoder]
    request: Callable[[StreamFormat], Request]

    def stream(self) -> Stream:
        """The stream as the family would describe it to the session."""
        return Stream(
            format=self.make_format(),
            decoder=self.make_decoder(),
            mode=self.mode,
            sample_ns=self.mode.sample_us * 1e3,
            spin_up_s=5.0,
            slowest_turn_s=1.0,
        )


@dataclass(frozen=True, slots=True)
class Rate:
    """A device as it is sold, sending in one mode.

    Attributes:
        name: For tables.
        kind: What it sends.
        baudrate: Speed of its line.
        samples_per_s: Points a second.
    """

    name: str
    kind: Kind
    baudrate: int
    samples_per_s: int


@dataclass(frozen=True, slots=True)
class Recording:
    """A stream that can be played for ever.

    A turn is complete when the first packet that belongs to the next one has come: only that tells.

    Attributes:
        descriptor: The seven bytes that announce it; none where the device only talks.
        head: Its beginning, played once.
        loop: A second of it, repeated from then on; it begins with the first packet of a turn.
        head_ends: Offsets in `head` at which turns become complete.
        loop_ends: Offsets in `loop` at which turns become complete.
    """

    descriptor: bytes
    head: bytes
    loop: bytes
    head_ends: tuple[int, ...]
    loop_ends: tuple[int, ...]


def _rplidar(profile: Profile) -> SimulatedRplidar:
    device = SimulatedRplidar(profile)
    device.spin_up_s = 0.0
    return device


def simulated(model: str) -> Any:
    """A simulated device of that name, whose rotor needs no time to speed up."""
    return family_of_simulated(model).simulate(model, spin_up=0.0)


def rplidar_kind(name: str, profile: Profile, mode: Mode) -> Kind:
    """What an RPLIDAR of that profile sends in one of its modes."""
    number = mode.response_type
    about = ScanMode(mode.id, mode.name, mode.us_q8 / 256, mode.max_distance_q8 / 256, number)
    request = rplidar_commands.scan if number == 0x81 else partial(rplidar_commands.express_scan, mode.id)
    return Kind(name, "rplidar", about, partial(_rplidar, profile), FORMATS[number], DECODERS[number], request)


def _4ros_kind(name: str) -> Kind:
    about = ScanMode(0, "Standard", 50.0, 30.0, 0x81, typical=True)
    device = partial(simulated, "ydlidar-4ros")
    return Kind(name, "ydlidar", about, device, PointCloud, CloudDecoder, ydlidar_commands.scan)


def _kinds() -> dict[str, Kind]:
    modes = tuple(Mode(each, f"mode {each:#x}", 0x81 + each, 8000, 40 * 256) for each in range(6))
    profile = Profile("bench", 0x71, 4_000_000, modes, typical=4)
    kinds = [rplidar_kind(f"{mode.response_type:#x} {_NAMES[mode.response_type]}", profile, mode) for mode in modes]
    return {kind.name: kind for kind in (*kinds, _4ros_kind("4ROS points"))}


def _rates() -> dict[str, Rate]:
    rates = [Rate("4ROS", _4ros_kind("4ROS points"), 512_000, 20_000)]
    for name in ("S3", "S2"):
        sold = PROFILES[f"rplidar-{name.lower()}"]
        for mode, samples in zip(sold.modes, (16_000, 32_000), strict=True):
            if name == "S3" and samples < 32_000:
                continue  # the same line as the S2's
            # The other drivers cannot all be told a mode: each takes what the device recommends, or a plain scan.
            kind = rplidar_kind(f"{name} {mode.name}", replace(sold, typical=mode.id), mode)
            rates.append(Rate(kind.name, kind, sold.baudrate, samples))
    return {rate.name: rate for rate in reversed(rates)}


KINDS = _kinds()
"""One stream of each of the seven formats."""

RATES = _rates()
"""The devices that are played."""

LIVE = ("S2 DenseBoost", "S2 Standard", "4ROS")
"""Those that everybody reads live."""


@cache
def capture(kind: Kind, seconds: float) -> bytes:
    """What a device of that kind sends in `seconds`, from the descriptor on."""
    device = kind.device()
    now = _STEP_NS
    device.receive(kind.request(kind.make_format()).data, now)
    end = now + round(seconds * 1e9)
    pieces = []
    while now < end:
        now += _STEP_NS
        pieces.append(device.transmit(now))
    return b"".join(pieces)


@cache
def recording(kind: Kind) -> Recording:
    """A beginning, and a second to repeat; all devices of `RATES` and `KINDS` make whole turns in one."""
    raw, wire, link = capture(kind, 2.5), kind.make_format(), Link()
    request = kind.request(wire)
    link.send_request(request)
    link.receive_data(raw, 0)
    packets, blocks, headings = b"", list[Block](), list[int]()
    for event in link.events_received():
        if isinstance(event, Packets):
            packets += event.data
            join_blocks(blocks, event.blocks)
            headings += [int(heading) & (BEGINS - 1) for heading in wire.headings(event)]
    offsets = packet_offsets(blocks)
    wraps = [
        at
        for at, (last, here) in enumerate(pairwise(headings), 1)
        if wire.whole or here < last - wire.full_turn // 2
    ]
    turns = 1000 * len(wraps) // 2400
    first, last = wraps[turns - 1], wraps[2 * turns - 1]
    start = offsets[first]
    expected = request.expects
    before = raw.index(packets[: offsets[1]]) if expected and expected.lines else DESCRIPTOR_SIZE
    return Recording(
        descriptor=raw[: before if expected else 0],
        head=packets[:start],
        loop=packets[start : offsets[last]],
        head_ends=tuple(offsets[at + 1] for at in wraps[: turns - 1]),
        loop_ends=tuple(offsets[at + 1] - start for at in wraps[turns - 1 : 2 * turns - 1]),
    )
