"""Finding lidars: which ports there are, and which device responds on each.

A port is written to without being named only when its USB adapter is one that lidars come with: an unexpected
byte can reset another device, such as an Arduino. Families share adapters, so only the protocol tells them apart.

There is one search at a time on this machine, in whatever program. A search asks at every port, and while it does,
each of them is busy for others. Two that run at the same time, as where the programs of two lidars begin with the
machine, would each find some ports busy and miss what is there.
"""

import asyncio
import errno
import logging
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Any, Final, Literal

from lidario.basics.arguments import path_of, shown
from lidario.basics.model import DeviceInfo
from lidario.basics.source import Source
from lidario.errors import ConnectFailed, ConnectReason, InvalidValue, LidarError
from lidario.families.adapters import ADAPTERS
from lidario.families.registry import FAMILIES
from lidario.port.background import run_in_thread, running_loop
from lidario.session.finding.connect import connect
from lidario.session.finding.listening import BY_ID

_log = logging.getLogger("lidario")

MOST_LISTS = 20
"""How often the ports are listed at most, where one after the other is unplugged meanwhile."""
LIST_AGAIN_S = 0.01
"""Time between two lists: the system takes some milliseconds to remove a port."""
NAME = "\0lidario: a search for lidars"
"""An abstract socket: it is no file, and the system lets go of it when its program dies."""
POLL_S = 0.02
LONGEST_S = 20.0
"""After that the other search hangs, as where its program was stopped by Ctrl-Z. Asking takes 4 s, asking with
patience 8 s, opening what was found 4 s."""
_here = threading.Lock()
_BY_NUMBERS: Final = {(each.vendor, each.product): name for name, each in ADAPTERS.items()}


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A serial port of this machine.

    Attributes:
        path: What to open.
        by_id: A name that stays the same when ports are plugged in another order; empty where there is none.
        adapter: The adapter's name if lidars come with it, else empty.
        description: What the system says of it.
    """

    path: str
    by_id: str
    adapter: str
    description: str


@dataclass(frozen=True, slots=True)
class Found:
    """Which device is at a port.

    Attributes:
        port: The port.
        info: What the device says it is; None when none was found.
        baudrate: Speed at which it responded; 0 when none was found.
        error: Why none was found; empty when one was.
        reason: The same in one word, as in `ConnectFailed`; empty when one was found.
    """

    port: PortInfo
    info: DeviceInfo | None
    baudrate: int
    error: str
    reason: ConnectReason | Literal[""] = ""


def list_serial_ports() -> list[PortInfo]:
    """Every serial port of this machine, by path; nothing is opened. It reads files: about 10 ms."""
    stable = {}
    with suppress(OSError):  # there is none, or the last port of it was unplugged just now
        stable = {os.path.realpath(link): str(link) for link in BY_ID.iterdir()}
    return [
        PortInfo(
            path=port.device,
            by_id=stable.get(os.path.realpath(port.device), ""),
            adapter=_BY_NUMBERS.get((port.vid, port.pid), ""),
            description=port.description if port.description != "n/a" else "",
        )
        for port in sorted(_listed(), key=lambda port: str(port.device))
    ]


def _listed() -> list[Any]:
    """The ports as pyserial lists them. It fails where one is unplugged meanwhile: then they are listed again."""
    from serial.tools import list_ports  # slow to import, and seldom needed

    for _ in range(MOST_LISTS - 1):
        try:
            return list(list_ports.comports())
        except (OSError, TypeError, ValueError):  # a file of that port is not there any more
            time.sleep(LIST_AGAIN_S)
    return list(list_ports.comports())


async def list_lidars(paths: Iterable[str | os.PathLike[str]] = ()) -> list[Found]:
    """Ask which device is at each port, at all ports at the same time.

    A device that streams is stopped by this. Where no port has a lidar, all are asked again for 8 s, which is
    enough for a lidar that boots. Another search on this machine, of whatever program, is waited for. Cancelling
    leaves every port closed.

    Args:
        paths: Ports to ask, whatever adapter they have; none: every port with an adapter that lidars come with.

    Returns:
        One entry for each port that was asked. Errors of a port are in its entry; none is raised.

    Raises:
        InvalidValue: `paths` is no list of paths, as the path of one port is none.
    """
    if isinstance(paths, str | bytes) or not isinstance(paths, Iterable):
        raise InvalidValue(f"write list_lidars(['/dev/ttyUSB0']): it takes a list of ports, not {shown(paths)}")
    names = [str(path_of(path, "a port")) for path in paths]
    running_loop()
    with await only_search():
        return await ask(list({name: PortInfo(name, "", "", "") for name in names}.values()), lambda _: True)


async def ask(ports: Sequence[PortInfo], is_wanted: Callable[[DeviceInfo], bool]) -> list[Found]:
    """Ask which device is at each port; none: at every port with an adapter that lidars come with.

    Where none of them is wanted, those that have not responded are asked once more, with patience.
    """
    # Off the loop: it reads a few files of each port.
    ports = ports or [port for port in await run_in_thread(list_serial_ports) if port.adapter]
    found = list(await asyncio.gather(*(_ask(port, patient=False) for port in ports)))
    if not any(each.info is not None and is_wanted(each.info) for each in found):
        late = [number for number, each in enumerate(found) if each.info is None]
        again = await asyncio.gather(*(_ask(ports[number], patient=True) for number in late))
        for number, each in zip(late, again, strict=True):
            found[number] = each
    return found


async def search_for(source: Source) -> ExitStack:
    """Where a source must be found first, wait for other searches, and keep them from beginning until it is closed.

    What was found is opened anew: close it when that is done. Meanwhile another search would hold the port.
    """
    return await only_search() if source.kind in ("auto", "id") else ExitStack()


async def find_source(source: Source, family: str | None = None) -> Source:
    """The source to open for ``auto`` and ``id:``; any other as it is.

    Raises:
        ConnectFailed: No lidar responds, or several do (reason ``ambiguous``); the text lists them.
    """
    if source.kind not in ("auto", "id"):
        return source
    serial = source.address.casefold() if source.kind == "id" else None

    def is_wanted(info: DeviceInfo) -> bool:
        return serial in (None, info.serial.casefold()) and family in (None, info.family)

    found = await ask((), is_wanted)
    wanted = [each for each in found if each.info is not None and is_wanted(each.info)]
    if len(wanted) == 1:
        (best,) = wanted
        own = best.info.family if best.info else ""
        return Source(best.port.path, "serial", best.port.path, {"baud": str(best.baudrate), "family": own})
    if wanted:
        raise _several(wanted)
    others = [] if found else [port.path for port in await run_in_thread(list_serial_ports)]
    raise _none(source, family, found, others)


async def _ask(port: PortInfo, *, patient: bool) -> Found:
    try:
        connection = await connect(Source(port.path, "serial", port.path), patient=patient)
    except LidarError as error:
        reason: ConnectReason = error.reason if isinstance(error, ConnectFailed) else "silent"
        return Found(port, None, 0, str(error), reason)
    await connection.dialogue.close()
    return Found(port, connection.info, connection.dialogue.port.baudrate, "")


def _none(source: Source, family: str | None, found: list[Found], others: list[str]) -> ConnectFailed:
    kind = "lidar" if family is None else f"lidar of the family {family!r}"
    what = f"no {kind} with serial number {source.address}" if source.kind == "id" else f"no {kind} found"
    if not found:
        tried = "no port has an adapter that lidars come with"
        cure = f"; name the port if it is one of {', '.join(others)}" if others else ". Is it plugged in?"
        without = f"\nWithout a lidar, a simulated one does: sim://{FAMILIES[0].simulated[0]}"
        return ConnectFailed(f"{what}: {tried}{cure}{without}", reason="missing")
    lines = "".join(f"\n{each.port.path}: {each.error or _title(each)}" for each in found)
    return ConnectFailed(f"{what} on {len(found)} port(s) tried:{lines}", reason="missing")


def _several(found: list[Found]) -> ConnectFailed:
    lines = "".join(f"\n{each.port.path}: {_title(each)}" for each in found)
    return ConnectFailed(f"{len(found)} lidars respond; name one:{lines}", reason="ambiguous")


def _title(found: Found) -> str:
    return f"{found.info.model}, serial number {found.info.serial}" if found.info else ""


async def only_search() -> ExitStack:
    """Wait until no other search runs; none begins until the result is closed. Cancelling ends the waiting."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    release = _begin()
    if release is None:
        _log.info("another search for lidars runs on this machine: waiting for its end")
    while release is None and loop.time() < began + LONGEST_S:
        await asyncio.sleep(POLL_S)
        release = _begin()
    ends = ExitStack()
    if release is not None:
        ends.callback(release)
    return ends


def _begin() -> Callable[[], None] | None:
    """Begin a search; returns what ends it, or None while another one runs."""
    if sys.platform != "linux":
        # Only those of this program are known.
        return _here.release if _here.acquire(blocking=False) else None
    try:
        name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    except OSError:  # a sandbox without such sockets: others are not known
        return lambda: None
    try:
        name.bind(NAME)
    except OSError as error:
        name.close()
        return None if error.errno == errno.EADDRINUSE else lambda: None
    return name.close
