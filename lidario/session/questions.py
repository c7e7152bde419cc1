"""Every question to a device and every setting of it, as a user calls them.

Each runs a script of the family by way of `Scanner.ask`, which interrupts the stream only where the device is
really asked. What a user has set is remembered where the session comes back by itself, and set again then.
"""

import asyncio
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TypeVar

from lidario.basics.arguments import finite, shown, whole, yes_or_no
from lidario.basics.model import DeviceInfo, Health, NetworkAddress, SampleRate, ScanMode
from lidario.errors import InvalidValue, RemoteProtocolError, Unsupported
from lidario.families.base import Device, Script
from lidario.session.finding.connection import At
from lidario.session.finding.reconnect import Reconnector
from lidario.session.streaming.modes import choose_mode, does_not_fit
from lidario.session.streaming.scanner import Scanner
from lidario.session.streaming.stream import ScanStream
from lidario.session.talking.handshake import healthy, restart

T = TypeVar("T")

SPEED_TOLERANCE = 0.05
"""Share by which the measured scan frequency may differ from the one that was set."""
SPEED_TIMEOUT_S = 10.0
"""Longest time that the rotor has to reach it; a rotor at rest needs 5 s at most (`Stream.spin_up_s`)."""
SLOWEST_LINE = 9600
FASTEST_LINE = 4_000_000
"""Bits a second of serial lines that adapters can do."""


class Questions(ABC):
    """What `Lidar` asks and sets."""

    def __init__(self, at: At, scanner: Scanner, reconnector: Reconnector) -> None:
        self._at = at
        self._scanner = scanner
        self._reconnector = reconnector
        # The scan frequency that was set last.
        self._hertz = math.nan

    @property
    def info(self) -> DeviceInfo:
        """What the device last said it is."""
        return self._at.info

    async def get_info(self) -> DeviceInfo:
        """Ask the device what it is; `info` has the result, too."""
        self._at.info = await self._scanner.ask(self._open_device().identify)
        return self._at.info

    async def get_health(self) -> Health:
        """Ask the device how it is; `Lidar.health` is what it said last.

        A question that interrupts a stream costs it a revolution or two, and about a second where the motor stops
        with the stream: who asks all the time gets no scans.
        """
        health = await self._scanner.ask(self._open_device().health)
        # Not later: the stream that this question interrupted is started by another task, in the next step.
        self._scanner.failures.take_note(health)
        return health

    async def get_modes(self) -> tuple[ScanMode, ...]:
        """The scan modes of the device, in its order; never empty. The device is asked once in a session."""
        self._check_open()
        return await self._scanner.modes()

    async def get_sample_rate(self) -> SampleRate:
        """Ask how long a sample takes, in microseconds; `Scan.time_increment_ns` is what it took.

        Raises:
            Unsupported: The device does not tell.
        """
        return await self._scanner.ask(self._open_device().sample_rate)

    async def get_scan_frequency(self) -> float:
        """Ask which scan frequency is set, in revolutions a second; `measured_scan_frequency` is the real one.

        Raises:
            Unsupported: It cannot be set.
        """
        return await self._scanner.ask(self._open_device().scan_frequency)

    async def get_scan_frequency_range(self) -> tuple[float, float]:
        """Ask for the slowest and the fastest scan frequency, in Hz.

        Raises:
            Unsupported: It cannot be set.
        """
        return await self._scanner.ask(self._open_device().scan_frequency_range)

    async def set_scan_frequency(self, hertz: float, *, verify: bool = True) -> float:
        """Set the scan frequency in revolutions a second; returns what the device made of it.

        While a stream runs and `verify` is set, it returns when the measured frequency is within 5 % of that, or
        another task has set another one. The stream goes on meanwhile where the device changes its speed in
        mid-scan; else it is started again. While none runs, the rotor stays at rest and takes that speed when one
        is started. Cancelling ends the waiting; the frequency may be set or not.

        Raises:
            InvalidValue: No number, or outside what the device can do; the stream is not interrupted.
            Unsupported: It cannot be set on this device.
            RemoteProtocolError: The device turns at another speed even after ten seconds.
        """
        verify = yes_or_no(verify, "verify")
        value = self._hertz = await self._set("scan frequency", lambda device: device.set_scan_frequency(hertz))
        await self._scanner.retune()
        if verify and self._scanner.control.is_scanning:
            await self._turns_at(value)
        return value

    async def set_motor_speed(self, rpm: float, *, verify: bool = True) -> float:
        """As `set_scan_frequency`, in revolutions a minute."""
        hertz = finite(rpm, "a motor speed") / 60
        return 60 * await self.set_scan_frequency(hertz, verify=verify)

    async def get_zero_offset(self) -> float:
        """Ask for the zero-angle offset the device was calibrated with, in degrees clockwise.

        It is not applied unless `set_zero_offset` says so.

        Raises:
            Unsupported: The device has none.
        """
        return await self._scanner.ask(self._open_device().zero_offset)

    async def set_zero_offset(self, on: bool) -> None:
        """Choose whether the zero-angle offset is added to every angle; off at first.

        Streams that run add it, or do not, from the next revolution on.

        Raises:
            InvalidValue: `on` is neither true nor false.
            Unsupported: The device has none.
        """
        on = yes_or_no(on, "the zero-angle offset")
        self._scanner.set_zero_offset(await self._set("zero offset", lambda device: device.apply_zero_offset(on)))

    async def set_power_down_protection(self, on: bool) -> bool:
        """Switch power-down protection and return the state the device confirms.

        With it on, the device stops by itself when its host falls silent for three seconds; the session repeats
        what keeps it going, from another thread too while the program blocks its event loop. The manual recommends
        it where lidar and host have separate power supplies. It lasts longer than the session: the next program
        finds it as this one left it.

        Raises:
            InvalidValue: `on` is neither true nor false.
            RemoteProtocolError: The device does not reach that state.
            Unsupported: The device has none.
        """
        on = yes_or_no(on, "power-down protection")
        return await self._set("protection", lambda device: device.power_down_protection(on))

    async def get_network_address(self) -> NetworkAddress:
        """Ask an Ethernet model which address it has been given.

        Raises:
            Unsupported: The device tells none: it is no Ethernet model, or its firmware is too old.
        """
        return await self._scanner.ask(self._open_device().network_address)

    async def set_network_address(self, address: NetworkAddress) -> None:
        """Give an Ethernet model another address, which it takes when it is reset or powered up.

        After that this session cannot reach it any more: close it, and open the new address. Write the address
        down: no document names a way back for a device whose address is lost.

        Args:
            address: The new one; ``NetworkAddress("0.0.0.0")`` to have it ask the network for one (DHCP).

        Raises:
            InvalidValue: Not an IPv4 address.
            Unsupported: As `get_network_address`.
            RemoteProtocolError: The device refuses it.
        """
        device = self._open_device()
        await self._scanner.ask(lambda: device.set_network_address(address))

    async def set_baudrate(self, baudrate: int) -> None:
        """Change the speed of the serial line, of device and port together.

        The device measures the new speed, which takes up to 1.6 s. Running streams are interrupted and go on at the
        new speed. For a speed that the typical scan mode does not fit, have a stream run in a mode that does.
        Cancelling returns the port to the speed before; the device hears nothing for a second then, also no stop
        request, since it may have taken the new speed. No document says whether a device keeps the speed when it
        is restarted; if it does not, open it anew.

        Raises:
            InvalidValue: Not a whole number from 9600 to 4000000, or too slow for the scan mode that runs, or for
                the typical one where none runs. No stream is interrupted.
            Unsupported: The line has no speed, or the device cannot change it; the speed is as before.
            ConnectFailed: The adapter cannot do that speed; it is as before.
            ResponseTimeout: The device has confirmed the speed, and does not respond at it.
        """
        baudrate = whole(baudrate, "a baud rate")
        if not SLOWEST_LINE <= baudrate <= FASTEST_LINE:
            raise InvalidValue(f"{shown(baudrate)} is no speed from {SLOWEST_LINE} to {FASTEST_LINE} baud")
        device = self._open_device()
        before = self._at.dialogue.port.baudrate
        if not before:
            raise Unsupported("the line to this device has no speed that can be changed")
        # A device that cannot do it at all says so first.
        device.set_baudrate(baudrate, before).close()
        modes = await self._scanner.modes()
        misfit = does_not_fit(device, modes, self._scanner.control.mode or choose_mode(modes, None), baudrate)
        if misfit:
            raise InvalidValue(f"{baudrate} baud are too slow: {misfit}")
        await self._scanner.between(lambda: self._change_speed(baudrate))
        await self.get_info()

    async def reset(self) -> Health:
        """Restart the device and wait until it responds again; streams are started again afterwards.

        What this session has set (speed, protection) is set again by the next start. Cancelling ends the waiting;
        a device that was told to restart does so all the same.

        Raises:
            ResponseTimeout: It does not come back.
            DeviceFault: It came back and reports an error.
            Unsupported: It hears no such request; the streams go on.
        """
        self._open_device().reset()
        health = await self._scanner.between(self._reset, vital=True)
        self._scanner.failures.take_note(health)
        return health

    async def _reset(self) -> Health:
        await restart(self._at.dialogue)
        return await healthy(self._at.dialogue)

    async def _change_speed(self, baudrate: int) -> None:
        dialogue = self._at.dialogue
        # Not earlier: another task may have changed it meanwhile.
        before = dialogue.port.baudrate
        if before == baudrate:
            return
        try:
            await dialogue.run(dialogue.device.set_baudrate(baudrate, before))
        except BaseException:
            # At once: the next request must be written at the speed that the device still has, or goes back to.
            dialogue.go_back_to(before)
            raise

    async def _turns_at(self, hertz: float) -> None:
        measured, stream = float("nan"), ScanStream(self._scanner, None, 1, False, self._check_open)
        limit = asyncio.timeout(SPEED_TIMEOUT_S)
        try:
            async with limit:
                async for scan in stream:
                    measured = scan.rpm / 60
                    if hertz != self._hertz or abs(measured - hertz) <= SPEED_TOLERANCE * hertz:
                        return
        except TimeoutError:
            if not limit.expired():  # no stream begins, of which `ResponseTimeout` tells
                raise
            raise RemoteProtocolError(
                f"{hertz:.2f} Hz is set, but the rotor turns at {measured:.2f} Hz after {SPEED_TIMEOUT_S:g} s"
            ) from None
        finally:
            # An error that the program keeps holds this frame, and the stream in it. So the stream is ended here.
            stream.release()

    async def _set(self, name: str, script: Callable[[Device], Script[T]]) -> T:
        """Set something on the device; one that comes back shall be set to it again."""
        device = self._open_device()
        value = await self._scanner.ask(lambda: script(device))
        self._reconnector.settings[name] = script
        return value

    def _open_device(self) -> Device:
        self._check_open()
        if self._at.dialogue.fatal is not None:  # then it is away
            raise self._reconnector.away_error()
        return self._at.dialogue.device

    @abstractmethod
    def _check_open(self) -> None:
        """Raise what ended the session, if anything did."""
