"""From a source to an open session: what `open_lidar` returns."""

from __future__ import annotations

import logging
import os
from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import anyio

from lidario.basics.arguments import finite, shown, whole, yes_or_no
from lidario.basics.entered import AsyncOnly
from lidario.basics.source import MOST_BAUD, Source, as_source
from lidario.basics.system import cause_of, is_exhausted
from lidario.config.read import Config, as_config
from lidario.errors import ConnectFailed, InvalidValue, LocalProtocolError, Unsupported
from lidario.families.registry import check_family, check_source
from lidario.port.background import running_loop
from lidario.port.guard import check_guard
from lidario.session.finding.discovery import find_source, only_search, search_for
from lidario.session.finding.reconnect import Reconnect, Reconnector
from lidario.session.lidar import Lidar
from lidario.session.talking.handshake import healthy

if TYPE_CHECKING:
    from lidario.sim.device import SimulatedDevice

_log = logging.getLogger("lidario")

DEFAULT_LATENCY_S = 0.005
_WRITE = "write `async with lidario.open_lidar(...) as lidar:`"


class _Asked(NamedTuple):
    """What `open_lidar` was asked for."""

    source: Source
    family: str | None
    baudrate: int | None
    latency: float
    keep_spinning: bool
    reconnect: Reconnect | None
    guard: bool
    config: Config


class OpenLidar(AsyncOnly):
    """What `open_lidar` returns: a context manager, or something to ``await`` and close by hand."""

    _instead = f"opening a lidar takes time: {_WRITE}, or `with lidario.open_sync(...) as lidar:`"

    def __init__(self, asked: _Asked) -> None:
        self._asked = asked
        self._lidar: Lidar | None = None
        self._entered = False

    def __await__(self) -> Generator[object, None, Lidar]:
        return self._open().__await__()

    async def __aenter__(self) -> Lidar:
        if self._entered:
            # It remembers one session, which it closes: the other one would be left open.
            raise LocalProtocolError("this open_lidar(...) is in use already: call open_lidar() for each session")
        self._entered = True
        try:
            self._lidar = await self._open()
        except BaseException:
            self._entered = False
            raise
        return self._lidar

    async def __aexit__(self, *_: object) -> None:
        lidar, self._lidar, self._entered = self._lidar, None, False
        if lidar is not None:
            await lidar.close()

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> NoReturn:
            # Also for what copies or inspects it: those ask for names with an underscore.
            words = f"the lidar is not open yet, so it has no {name!r}: {_WRITE}" if hasattr(Lidar, name) else ""
            raise AttributeError(words or f"{type(self).__name__!r} object has no attribute {name!r}")

    def __aiter__(self) -> NoReturn:
        raise LocalProtocolError(f"the lidar is not open yet: {_WRITE}, then `async for scan in lidar.scans():`")

    async def _open(self) -> Lidar:
        try:
            return await self._open_asked()
        except (OSError, MemoryError) as error:
            # Modules are loaded at their first use, too: that may be what finds nothing left.
            if not is_exhausted(error):
                raise
            raise ConnectFailed(f"{self._asked.source.text}: {cause_of(error)}", reason="missing") from error

    async def _open_asked(self) -> Lidar:
        asked = self._asked
        running_loop()
        # anyio imports its backend where it is first used: 30 ms on the event loop, and an error where the program
        # has no file descriptor left. That must not come while a device is being stopped.
        anyio.CancelScope()
        if asked.guard and asked.source.is_driven_from_here:
            check_guard()
        try:
            with await search_for(asked.source):
                return await self._open_found(await find_source(asked.source, asked.family))
        except ConnectFailed as error:
            if error.reason != "busy" or asked.source.kind != "serial":
                raise
        # A search asks at every port, and may do so just now.
        with await only_search():
            return await self._open_found(asked.source)

    async def _open_found(self, source: Source) -> Lidar:
        asked = self._asked
        if source.kind == "file" and asked.keep_spinning:
            raise InvalidValue("keep_spinning: a recording has no motor")
        if asked.guard and not source.is_driven_from_here:
            _log.info("guard: nothing at %s goes on when this program dies, so there is none", source.text)
        reconnector = Reconnector(asked.reconnect, source)
        try:
            return await self._open_on(source, reconnector)
        except BaseException:
            reconnector.release()
            raise

    async def _open_on(self, source: Source, reconnector: Reconnector) -> Lidar:
        asked = self._asked
        connection = await reconnector.connect(source, asked.family, asked.baudrate, guard=asked.guard)
        try:
            # A recording and another machine's lidar tell it themselves, and only when they are open.
            check_family(source, asked.family, connection.info.family)
            if asked.keep_spinning and not connection.dialogue.device.can_keep_spinning:
                raise Unsupported(
                    f"keep_spinning: the motor of a {connection.info.model} stops with its laser. Open it without"
                )
            if not connection.dialogue.device.can_be_stopped:
                _log.warning(
                    "this %s cannot be stopped from here: its motor turns while it has power", connection.info.model
                )
            health = await healthy(connection.dialogue)
            own = asked.config.of(connection.info.serial)
            if source.kind in ("file", "zenoh"):
                # A recording is what it was, and another machine's lidar is set there.
                own = replace(own, mode=None, speed_rpm=None)
            lidar = Lidar(connection, health, source.text, asked.latency, asked.keep_spinning, reconnector, own)
            connection.dialogue.port.tell_guard()
        except BaseException:
            await connection.dialogue.close()
            raise
        if own.speed_rpm is not None:
            try:
                await lidar.set_motor_speed(own.speed_rpm, verify=False)
            except BaseException as error:
                await lidar.close()
                if isinstance(error, Unsupported | InvalidValue):
                    raise type(error)(f"{asked.config.path}: speed_rpm = {own.speed_rpm:g}: {error}") from None
                raise
        return lidar


def open_lidar(
    source: str | os.PathLike[str] | SimulatedDevice = "auto",
    *,
    family: str | None = None,
    baudrate: int | None = None,
    latency: float = DEFAULT_LATENCY_S,
    keep_spinning: bool = False,
    reconnect: bool | Reconnect = False,
    guard: bool = False,
    config: Config | str | os.PathLike[str] | None = None,
) -> OpenLidar:
    """Open a device, for use in ``async with`` or with ``await``.

    The port is opened exclusively. The device is stopped in case it still streams, asked what it is and how it is,
    and reset once if it has stopped to protect itself. Cancelling leaves laser and motor off and the port closed,
    which takes up to 4 s; where the family is not known yet, `docs/promises.md` has what cannot be stopped then.

    Args:
        source: Where it is, see `lidario.basics.source`; a path is a serial port or a recording; or a simulated
            device of your own, which is then connected in memory and lives on the event loop's clock.
        family: Name of its family; None to find out.
        baudrate: Speed of the line; None to find out.
        latency: Seconds by which a scan may be late because the port is polled only from time to time while a
            stream runs. With 0 the program is woken for each delivery from shortly before the end of a revolution
            until it has come; before that, at any setting, as seldom as the kernel's buffer allows.
        keep_spinning: Leave the motor on when the stream or the session ends; only the measuring stops.
        reconnect: Come back when the device is unplugged, restarts, falls silent or protects itself: find it again
            by its own serial number, set it as it was set, and go on in the same streams. True comes back for as
            long as it takes; a `Reconnect` says how long. See `docs/reconnect.md`. It is about a device that was
            open: the first opening fails as without it.
        guard: Start a small process with the session, which switches laser and motor off when this program is
            killed (``kill -9``, `os._exit`, no memory left, a crash). See `docs/robot.md`. Simulated devices,
            recordings and other machines' lidars need none, and have none.
        config: A file of settings, or what `read_config` made of one: the mode and the filters of all streams, the
            speed, and what `Lidar.config` tells, by the serial number of the lidar. See `docs/settings.md`. Of a
            recording and of another machine's lidar, speed and mode are what they are.

    Raises:
        ConnectFailed: No such port, no permission, busy, silent, or ambiguous; each says which, and the cure.
        DeviceFault: The device reports an error that a reset did not cure.
        DeviceLost: The port died meanwhile.
        RecordingError: Nothing can be read of a recording.
        RemoteProtocolError: The device gives a different identity each time: the line damages what it carries.
        InvalidValue: An argument is wrong: `baudrate` is a whole number above 0, `latency` a number of
            seconds from 0 on; `keep_spinning` of a recording; or `family` is not that of the source.
        Unsupported: `keep_spinning` on a device whose motor stops with its laser, or a speed in `config` for one
            whose speed cannot be set; or `guard` on a system that
            cannot do it, such as Windows.
    """
    where = as_source(source)
    check_source(where, family)
    if baudrate is not None and not 0 < (baudrate := whole(baudrate, "a baud rate")) <= MOST_BAUD:
        raise InvalidValue(f"a baud rate is a number of bits per second, such as 115200, not {shown(baudrate)}")
    if (latency := finite(latency, "the latency")) < 0:
        raise InvalidValue(f"the latency is a number of seconds from 0 on, not {latency:g}")
    policy = reconnect if isinstance(reconnect, Reconnect) else None
    if policy is None and yes_or_no(reconnect, "reconnect, if it is no Reconnect(limit_s=…),"):
        policy = Reconnect()
    spinning, guarded = yes_or_no(keep_spinning, "keep_spinning"), yes_or_no(guard, "guard")
    settings = as_config(config)
    return OpenLidar(_Asked(where, family, baudrate, latency, spinning, policy, guarded, settings))
