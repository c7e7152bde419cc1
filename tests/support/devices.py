"""Simulated devices for session tests, one of each family, with what the tests ask of both."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pytest

from lidario import NetworkAddress, ScanStream, StreamFailed
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from lidario.session.opening import OpenLidar, open_lidar
from tests.support.discards import PROTECTED
from tests.support.families import ABOUT
from tests.support.simulated_rplidar import DUTY_660, begin

S = TypeVar("S")
T = TypeVar("T")


@dataclass
class Rig:
    """A simulated device and how to open it."""

    family: str  # name of its family
    device: Any  # the device; typed loosely, since the tests use hooks that only simulated devices have
    turn_s: float  # length of one turn at the speed it starts with

    def open(self, **options: Any) -> OpenLidar:
        """Open it in memory."""
        return open_lidar(self.device, family=self.family, **options)

    @asynccontextmanager
    async def read(self, mode: str | None = None, **options: Any) -> AsyncIterator[tuple[Lidar, ScanStream]]:
        """Open it in memory, and read: a session, and a stream of it that has brought its first scan."""
        async with self.open(**options) as lidar, scanning(lidar, mode) as stream:
            yield lidar, stream


@asynccontextmanager
async def scanning(lidar: Lidar, mode: str | None = None, **options: Any) -> AsyncIterator[ScanStream]:
    """A stream of a session that has brought its first scan."""
    async with lidar.scans(mode, **options) as stream:
        await anext(stream)
        yield stream


def leave_streaming(device: Any, now: int, mode_id: int = 1) -> None:
    """Have it scan for some time already, and be in the midst of a packet, as after a program that was killed."""
    profile, start, past = device.profile, b"", 123_456_789
    match profile.name.partition("-")[0]:
        case "rplidar":
            mode = profile.mode(mode_id)
            start = (DUTY_660 if profile.motor == "pwm" else b"") + begin(mode)
            past = 10 * mode.period_ns + mode.packet[0] * 4 * 10**9 // device.baudrate
        case "ydlidar":
            start, past = b"\xa5\x60", 400 * profile.sample_ns + 36 * 10**10 // device.baudrate
        case "hokuyo":
            start = b"MD%04d%04d01000\n" % profile.span
        case "hlds":
            start = b"b"
    usual = device.spin_up_s, device.response_delay_s
    device.spin_up_s = device.response_delay_s = 0.0
    device.transmit(now - past)
    device.receive(start, now - past)
    device.transmit(now)
    device.spin_up_s, device.response_delay_s = usual
    device.log.clear()


MAKERS = {name: about.MAKER for name, about in ABOUT.items()}
FAMILIES = tuple(name for name, maker in MAKERS.items() if maker.obeys and maker.tuned)
"""Those whose devices obey requests, and so are asked, stopped and reset in most tests of sessions."""
EVERY_FAMILY = tuple(MAKERS)
SWITCHED = ("rplidar-a1", "rplidar-a2")
"""Models whose motor takes no speed: it is switched by DTR, and by an accessory board."""
EVERY_KIND = (*EVERY_FAMILY, *SWITCHED)
OTHERS = tuple(name for name in EVERY_KIND if name not in FAMILIES)
both_families = pytest.mark.parametrize("family", FAMILIES)


def in_turns(rows: Sequence[S], columns: Sequence[T], kinds: Sequence[str]) -> list[tuple[S, T, str]]:
    """Every pair once, with these devices in turns."""
    pairs = [(row, column, at + to) for at, row in enumerate(rows) for to, column in enumerate(columns)]
    return [(row, column, kinds[number % len(kinds)]) for row, column, number in pairs]


def make_rig(name: str, **options: Any) -> Rig:
    """A fresh device of this model, or the usual one of this family, whose rotor needs no time to speed up."""
    family = name.partition("-")[0]
    maker = MAKERS[family]
    device = maker.make(maker.model if name == family else name, **options)
    device.spin_up_s = 0.0
    return Rig(family, device, maker.turn_s)


def names(rig: Rig, *, obeyed: bool | None = None) -> list[str]:
    """Names of the requests the device has seen."""
    return [each.name for each in rig.device.log if obeyed is None or each.obeyed is obeyed]


MOTOR_OFF = bytes.fromhex("a5a80200000f")
MOVING = ("stop", "reset", "start", "scan", "force_scan", "express_scan", "motor_speed_ctrl")
"""Requests that set the device in motion or leave it still."""


def is_off(device: Any) -> bool:
    """Whether laser and motor are off."""
    return not (device.scanning or device.motor_on)


def left_still(rig: Rig) -> bool:
    """Whether laser and motor are off, and the last request that could move the device was one that stops it.

    A device in Protection Stop ignores STOP, but it has heard it. One that only talks cannot be left in any other
    state than it is in, unless the control line DTR switches it.
    """
    profile = rig.device.profile
    if not getattr(profile, "commands", True):
        return not getattr(profile, "by_dtr", False) or not rig.device.motor_on
    heard = [
        each.name for each in rig.device.log if (each.obeyed or each.why == PROTECTED) and each.data != MOTOR_OFF
    ]
    moved = [name for name in heard if name in MOVING]
    return is_off(rig.device) and moved[-1:] in ([], ["stop"], ["reset"])


@contextmanager
def left_still_at_the_end(rig: Rig) -> Iterator[Rig]:
    """Whatever is done with the device in the block, laser and motor are off behind it."""
    yield rig
    assert left_still(rig) or not rig.device.log, names(rig)[-6:]


def hears_only(rig: Rig, hears: Callable[[bytes], bool]) -> None:
    """From now on the device hears of what is written only that of which this is true."""
    receive = rig.device.receive

    def hear(data: bytes, now: int) -> None:
        if hears(data):
            receive(data, now)

    rig.device.receive = hear


def babble(device: Any) -> None:
    """From now on the device sends noise, whatever it is told: half of what a fast line carries."""
    random = np.random.default_rng(1)
    device.transmit = lambda now: random.bytes(1024)
    device.wakeup = lambda now: now + 20_000_000


ARGUMENTS: dict[str, tuple[object, ...]] = {
    "set_scan_frequency": (9.0,),
    "set_motor_speed": (540.0,),
    "set_zero_offset": (True,),
    "set_network_address": (NetworkAddress("192.168.11.2"),),
    "set_baudrate": (1_500_000,),
    "set_power_down_protection": (True,),
}
"""Of the calls of a session that take any."""


def call(lidar: Lidar, name: str) -> Awaitable[Any]:
    """A call of a session by its name, with arguments that are right."""
    called: Awaitable[Any] = getattr(lidar, name)(*ARGUMENTS.get(name, ()))
    return called


async def some(stream: AsyncIterator[T], count: int) -> list[T]:
    """The next ones of a stream."""
    return [await anext(stream) for _ in range(count)]


async def take(lidar: Lidar, count: int) -> list[Scan]:
    """That many scans, from a stream of their own."""
    scans: list[Scan] = []
    async with lidar.scans() as stream:
        async for scan in stream:
            scans.append(scan)
            if len(scans) == count:
                break
    return scans


async def end_of(stream: AsyncIterator[object], kind: type[Exception] = StreamFailed, why: str = "") -> Any:
    """Take scans until the stream ends; the error that it ends with."""
    with pytest.raises(kind, match=why or None) as caught:
        async with asyncio.timeout(60.0):
            while True:
                await anext(stream)
    return caught.value


def change_info(rig: Rig, change: Callable[[bytes], bytes], patch: pytest.MonkeyPatch) -> None:
    """Have what the device tells of itself changed on the way."""
    if rig.family == "rplidar":
        respond = rig.device.respond
        patch.setattr(
            rig.device,
            "respond",
            lambda kind, data, request: respond(kind, change(data) if kind == 0x04 else data, request),
        )
    else:
        info = rig.device.info
        patch.setattr(rig.device, "info", lambda: change(info()))
