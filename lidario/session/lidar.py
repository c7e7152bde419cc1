"""The session with one device, from the first byte to the last.

Every method that talks to the device may be called in any state. While streams run, it interrupts them, asks,
and has them taken up again; the readers see a longer step between two time stamps, and `Stats.interruptions`
counts it. However a session ends, what stops laser and motor has been written before anything is awaited.
"""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Generator
from types import TracebackType
from typing import TYPE_CHECKING, Self

from lidario.errors import DeviceLost, RemoteProtocolError, SessionClosed
from lidario.families.base import Device
from lidario.model import DeviceInfo, Health, SampleRate, Scan, ScanMode, Stats
from lidario.port.port import Port, Tap
from lidario.session.connect import Connection, connect, shut_down
from lidario.session.discovery import find_source
from lidario.session.handshake import healthy, restart
from lidario.session.scanner import Scanner
from lidario.session.stream import ScanStream
from lidario.source import Source, parse_source

if TYPE_CHECKING:
    from lidario.sim.device import SimulatedDevice

__all__ = ["DEFAULT_LATENCY_S", "Lidar", "OpenLidar", "open_lidar"]

DEFAULT_LATENCY_S = 0.005
SPEED_TOLERANCE = 0.05
SPEED_TIMEOUT_S = 10.0


class Lidar:
    """One open device; made by `open_lidar`, and best used as its context manager.

    Attributes:
        source: The source it was opened from.
        info: What the device says it is.
        health: What it last said of its state.
    """

    def __init__(
        self, connection: Connection, health: Health, source: str, latency: float, keep_spinning: bool
    ) -> None:
        self.source = source
        self.info: DeviceInfo = connection.info
        self.health = health
        self._device = connection.device
        self._dialogue = connection.dialogue
        self._timing = connection.family.timing
        self._keep_spinning = keep_spinning
        self._scanner = Scanner(connection.dialogue, connection.device, latency, keep_spinning)
        self._closed = False
        self._abandoned = weakref.finalize(self, _abandon, connection.port, connection.device, keep_spinning)

    def __repr__(self) -> str:
        state = "closed" if self._closed else "scanning" if self.is_scanning else "idle"
        return f"<Lidar {self.info.model} {self.info.serial} on {self.source}: {state}>"

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs, or is about to be taken up again."""
        return self._scanner.wanted is not None

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs, if one does."""
        return None if self._scanner.wanted is None else self._scanner.wanted.mode

    @property
    def scan_frequency(self) -> float | None:
        """Measured turns a second, from the latest scan; None before the first."""
        return None if self._scanner.latest is None else self._scanner.latest.rpm / 60

    @property
    def stats(self) -> Stats:
        """Counters since the session was opened."""
        link, assembled = self._dialogue.link.stats, self._scanner.stats
        return Stats(
            bytes_received=link.bytes_received,
            packets=link.packets,
            lost_packets=assembled.lost_packets,
            skipped_bytes=link.skipped_bytes,
            skipped_stretches=link.skipped_stretches,
            stray_bytes=link.stray_bytes,
            late_answers=link.late_answers,
            scans=assembled.scans,
            broken_scans=assembled.broken_scans,
            dropped_scans=self._scanner.hub.dropped,
            interruptions=self._scanner.interruptions,
            keepalives=self._scanner.keepalives,
        )

    def scans(self, mode: str | int | None = None, *, depth: int = 1, force: bool = False) -> ScanStream:
        """A stream of full revolutions, for ``async for``; several may run side by side.

        Args:
            mode: Name or id of a scan mode; None for the one that runs, or else the device's typical one.
            depth: Scans kept for a reader that falls behind; the oldest beyond that are dropped and counted.
            force: Ask the device to measure even when the motor is not up to speed.
        """
        return ScanStream(self._scanner, mode, depth, force, self._check_open)

    async def scan(self, mode: str | int | None = None) -> Scan:
        """One full revolution. Laser and motor stop afterwards unless another stream runs.

        Raises:
            DeviceLost: No scan came.
        """
        async with self.scans(mode) as stream:
            return await anext(stream)

    async def stop(self) -> None:
        """Stop laser and motor and end every stream; returns when the line is quiet."""
        self._check_open()
        await self._scanner.stop()

    async def get_info(self) -> DeviceInfo:
        """Ask the device what it is. Raises ResponseTimeout or DeviceLost, as every question does."""
        self.info = await self._scanner.ask(self._open_device().identify)
        return self.info

    async def get_health(self) -> Health:
        """Ask the device how it is."""
        self.health = await self._scanner.ask(self._open_device().health)
        return self.health

    async def get_modes(self) -> tuple[ScanMode, ...]:
        """The scan modes the device has; asked for once."""
        self._check_open()
        return await self._scanner.modes()

    async def get_sample_rate(self) -> SampleRate:
        """Ask how long a sample takes. Raises Unsupported where the device does not tell."""
        return await self._scanner.ask(self._open_device().sample_rate)

    async def get_scan_frequency(self) -> float:
        """Ask which scan frequency is set, in turns a second. Raises Unsupported where it cannot be set."""
        return await self._scanner.ask(self._open_device().scan_frequency)

    async def get_scan_frequency_range(self) -> tuple[float, float]:
        """Ask for the slowest and the fastest scan frequency. Raises Unsupported where it cannot be set."""
        return await self._scanner.ask(self._open_device().scan_frequency_range)

    async def set_scan_frequency(self, hertz: float, *, verify: bool = True) -> float:
        """Set the scan frequency in turns a second; returns what the device made of it.

        While a stream runs and `verify` is set, it returns when the measured frequency is within 5 % of that.
        While none runs, the rotor stays at rest and takes that speed when one is started.

        Raises:
            ValueError: Outside what the device can do.
            Unsupported: It cannot be set on this device.
            RemoteProtocolError: The device turns at another speed even after ten seconds.
        """
        device = self._open_device()
        value = await self._scanner.ask(lambda: device.set_scan_frequency(hertz))
        if verify and self.is_scanning:
            await self._turns_at(value)
        return value

    async def set_motor_speed(self, rpm: float, *, verify: bool = True) -> float:
        """As `set_scan_frequency`, in turns a minute."""
        return 60 * await self.set_scan_frequency(rpm / 60, verify=verify)

    async def zero_offset(self) -> float:
        """Ask for the zero-angle offset the device was calibrated with, in degrees clockwise.

        It is not applied unless `use_zero_offset` says so. Raises Unsupported where there is none.
        """
        return await self._scanner.ask(self._open_device().zero_offset)

    async def use_zero_offset(self, on: bool) -> None:
        """Choose whether the zero-angle offset is added to every angle; off at first.

        It holds from the next start of a stream; streams that run are taken up again with it at once.
        Raises Unsupported where there is none.
        """
        device = self._open_device()
        await self._scanner.ask(lambda: device.apply_zero_offset(on))

    async def power_down_protection(self, on: bool) -> bool:
        """Switch power-down protection and return the state the device confirms.

        With it on, the device stops by itself when its host falls silent for three seconds; the session repeats
        what keeps it going. Raises Unsupported where there is none.
        """
        device = self._open_device()
        return await self._scanner.ask(lambda: device.power_down_protection(on))

    async def reset(self) -> Health:
        """Restart the device and wait until it answers again; streams are taken up afterwards.

        Raises:
            ResponseTimeout: It does not come back.
            DeviceFault: It came back and reports an error.
        """
        self._check_open()
        self.health = await self._scanner.between(self._reset)
        return self.health

    def tap(self, tap: Tap) -> None:
        """Have `tap` called with every chunk of raw bytes, in and out."""
        self._check_open()
        self._dialogue.port.add_tap(tap)

    def untap(self, tap: Tap) -> None:
        """Take `tap` out again."""
        self._dialogue.port.remove_tap(tap)

    async def close(self) -> None:
        """Stop laser and motor and close the port; harmless when done before.

        What stops them has been written when the first ``await`` is reached, so cancelling it cannot prevent it.
        Every stream ends with SessionClosed.
        """
        if self._closed:
            return
        self._closed = True
        self._abandoned.detach()
        self._scanner.halt()
        self._scanner.hub.end(SessionClosed("the session was closed"))
        last_words = (self._device.stop(),) if self._keep_spinning else self._device.halt()
        await shut_down(self._dialogue, () if self._dialogue.fatal else last_words)

    async def __aenter__(self) -> Self:
        self._check_open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def _reset(self) -> Health:
        await restart(self._dialogue, self._device, self._timing)
        return await healthy(self._dialogue, self._device, self._timing)

    async def _turns_at(self, hertz: float) -> None:
        measured = float("nan")
        try:
            async with asyncio.timeout(SPEED_TIMEOUT_S):
                async for scan in self.scans():
                    measured = scan.rpm / 60
                    if abs(measured - hertz) <= SPEED_TOLERANCE * hertz:
                        return
        except TimeoutError:
            raise RemoteProtocolError(
                f"{hertz:.2f} Hz is set, but the rotor turns at {measured:.2f} Hz after {SPEED_TIMEOUT_S:g} s"
            ) from None

    def _open_device(self) -> Device:
        self._check_open()
        return self._device

    def _check_open(self) -> None:
        if self._closed:
            raise SessionClosed(f"the session on {self.source} was closed; open_lidar() makes a new one")
        if self._dialogue.fatal is not None:
            raise DeviceLost(str(self._dialogue.fatal)) from self._dialogue.fatal


class OpenLidar:
    """What `open_lidar` returns: a context manager, or something to ``await`` and close by hand."""

    def __init__(
        self, source: Source, family: str | None, baudrate: int | None, latency: float, keep_spinning: bool
    ) -> None:
        self._source = source
        self._family = family
        self._baudrate = baudrate
        self._latency = latency
        self._keep_spinning = keep_spinning
        self._lidar: Lidar | None = None

    def __await__(self) -> Generator[object, None, Lidar]:
        return self._open().__await__()

    async def __aenter__(self) -> Lidar:
        self._lidar = await self._open()
        return self._lidar

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lidar is not None:
            await self._lidar.close()

    async def _open(self) -> Lidar:
        source = await find_source(self._source)
        connection = await connect(source, self._family, self._baudrate)
        try:
            health = await healthy(connection.dialogue, connection.device, connection.family.timing)
            return Lidar(connection, health, source.text, self._latency, self._keep_spinning)
        except BaseException:
            await shut_down(connection.dialogue, connection.device.halt())
            raise


def open_lidar(
    source: str | SimulatedDevice = "auto",
    *,
    family: str | None = None,
    baudrate: int | None = None,
    latency: float = DEFAULT_LATENCY_S,
    keep_spinning: bool = False,
) -> OpenLidar:
    """Open a device, for use in ``async with`` or with ``await``.

    It is opened for nobody else beside, stopped in case it still streams, asked what it is and how it is, and
    reset once if it has stopped to protect itself. Cancelling it leaves laser and motor off and the port closed.

    Args:
        source: Where it is, see `lidario.source`; or a simulated device of your own, which is then connected in
            memory and lives on the event loop's clock.
        family: Name of its family; None to find out.
        baudrate: Speed of the line; None to find out.
        latency: Seconds by which a scan may be late because the port is only looked at from time to time while a
            stream runs. With 0 the program is woken for each delivery from shortly before a turn's end is due until
            it has come; before that, at any setting, as seldom as the kernel's buffer allows.
        keep_spinning: Leave the motor on when the session ends; only the measuring stops.

    Raises:
        ConnectFailed: No such port, no permission, busy, silent, or ambiguous; each says which, and the cure.
        DeviceFault: The device reports an error that a reset did not cure.
        DeviceLost: The port died meanwhile.
    """
    where = parse_source(source) if isinstance(source, str) else Source("simulated", "device", device=source)
    return OpenLidar(where, family, baudrate, latency, keep_spinning)


def _abandon(port: Port, device: Device, keep_spinning: bool) -> None:
    """The session was never closed and nobody holds it any more, or the program ends: leave the device still."""
    last_words = (device.stop(),) if keep_spinning else device.halt()
    port.abandon(b"".join(request.data for request in last_words))
