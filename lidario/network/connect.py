"""From ``zenoh:KEY`` to a lidar that has introduced itself.

The publishers under the key are asked for their status. If none responds, the first message is read: a LaserScan
of any ROS 2 node is a source too, although nothing is known of its device.
"""

import asyncio
from collections.abc import Callable
from typing import Final, TypeAlias

import anyio

from lidario.basics.model import DeviceInfo, Health, HealthStatus
from lidario.basics.source import Source
from lidario.errors import ConnectFailed, InvalidValue
from lidario.families.base import Family
from lidario.families.registry import FAMILIES
from lidario.network.bus import DEFAULT_ROUTER, Bus, Sample
from lidario.network.device import RemoteDevice, RemoteStreams, whole_scans
from lidario.network.keys import LASERSCAN_IN_KEY, check_key, parse_attachment, parse_token, status_key, tokens_of
from lidario.network.messages import whole_scan
from lidario.network.port import RemotePort
from lidario.network.router import check_router
from lidario.network.status import Status, statuses
from lidario.recording.about import About
from lidario.recording.chronicle import StreamBegan

WAIT_S: Final = 5.0
"""How long to wait for the first message of a publisher that does not respond, or for a lidar that is away."""
TOKENS_S: Final = 1.0  # how long the router has to list tokens
ASK_AGAIN_S: Final = 0.5  # how often publishers are asked meanwhile
_UNKNOWN: Final = Health(HealthStatus.WARNING, 0, "the publisher does not tell")


Remote: TypeAlias = tuple[RemotePort, Family, RemoteDevice]
"""A lidar of another machine: where it is received, whose code understands it, and what it has told."""


async def open_remote(source: Source) -> Remote:
    """Connect to the router, and to the publisher. Cancelling leaves nothing open.

    Raises:
        ConnectFailed: The key or the address of the router cannot be right (``source``); there is no router
            (``refused``); nobody publishes under the key (``missing``), or several do (``ambiguous``); or the one
            that publishes there does not respond (``silent``).
        Unsupported: The package is not installed.
    """
    router = source.options.get("router", DEFAULT_ROUTER)
    try:
        key = check_key(source.address, wildcards=True)
        check_router(router)
    except InvalidValue as error:
        raise ConnectFailed(str(error), reason="source") from error
    bus = await Bus.open(router)
    try:
        return await _meet(bus, key)
    except BaseException:
        with anyio.CancelScope(shield=True):
            await bus.close()
        raise


async def _meet(bus: Bus, key: str) -> Remote:
    deadline = asyncio.get_running_loop().time() + WAIT_S
    leave: Callable[[], None] | None = None
    first: Sample | None = None
    while True:
        found = await _ask(bus, key)
        if len(found) > 1:
            lines = "".join(f"\nzenoh:{each}" for each in sorted(found))
            raise ConnectFailed(
                f"{len(found)} lidars are published under {key}; name one:{lines}", reason="ambiguous"
            )
        left = deadline - asyncio.get_running_loop().time()
        if not found:
            if first is not None:
                return _of_message(bus, first)
            first = await _first_message(bus, key, max(0.0, min(left, ASK_AGAIN_S)))
            if first is None and left <= 0:
                raise await _nobody(bus, key)
            # A publisher may have come meanwhile that responds.
            continue
        ((place, status),) = found.items()
        began = _stream_of(status)
        if began is not None:
            remote = _remote(bus, place, status, began)
            if leave is not None:
                leave()
            return remote
        if left <= 0:
            lost = f": {status.lost}" if status.lost else ""
            raise ConnectFailed(f"zenoh:{place} is published, but its lidar does not scan{lost}", reason="silent")
        if leave is None:
            # A lidar that rests until it is read starts for this reader (`Broadcast.run`).
            leave = bus.subscribe(place, lambda _: None)
        await asyncio.sleep(0.1)


async def _nobody(bus: Bus, key: str) -> ConnectFailed:
    """Why no lidar was found: a publisher that hangs still holds its token."""
    tokens = [token for text in await bus.tokens(tokens_of(key), TOKENS_S) if (token := parse_token(text))]
    if tokens:
        one = tokens[0]
        text = f"zenoh:{one.key} is published by {one.robot}, which does not respond: does its program hang?"
        return ConnectFailed(text, reason="silent")
    text = f"no lidar is published under {key}; `lidario devices --zenoh --router {bus.router}` lists all"
    return ConnectFailed(text, reason="missing")


def _of_message(bus: Bus, first: Sample) -> Remote:
    """A publisher of which nothing is known but its first message."""
    topic, is_ros, _ = first.key.partition(LASERSCAN_IN_KEY)
    info = DeviceInfo("ros2" if is_ros else "unknown", "LaserScan" if is_ros else "unknown", 0, "", 0, topic)
    attachment = parse_attachment(first.attachment)
    sender = "" if attachment is None else attachment.gid.hex()
    status = Status("ros" if is_ros else "scan", "", About(info, _UNKNOWN), sender=sender)
    return _remote(bus, first.key, status, whole_scans(None))


async def _ask(bus: Bus, key: str) -> dict[str, Status]:
    found: dict[str, Status] = {}
    for place, status in await statuses(bus, key):
        if place in found and found[place].sender != status.sender:
            names = " and ".join(sorted({found[place].robot, status.robot}))
            raise ConnectFailed(
                f"two publishers send under zenoh:{place} ({names}): give each a key of its own", reason="ambiguous"
            )
        found[place] = status
    return found


async def _first_message(bus: Bus, key: str, seconds: float) -> Sample | None:
    """The first one that is a scan; None where none comes in time."""
    came: asyncio.Future[Sample] = asyncio.get_running_loop().create_future()

    def take(sample: Sample) -> None:
        if whole_scan(sample, 0) is not None and not came.done():
            came.set_result(sample)

    leave = bus.subscribe(key, take)
    try:
        async with asyncio.timeout(seconds):
            return await came
    except TimeoutError:
        return None
    finally:
        leave()


def _stream_of(status: Status) -> StreamBegan | None:
    """The stream that runs; None where the lidar is away."""
    if status.form == "raw":
        return status.about.running
    return None if status.mode is None and status.lost else whole_scans(status.mode)


def _remote(bus: Bus, key: str, status: Status, began: StreamBegan) -> Remote:
    raw = status.form == "raw"
    family = next((each for each in FAMILIES if each.name == status.about.info.family), None)
    if family is None:
        if raw:
            raise ConnectFailed(
                f"zenoh:{key} sends the bytes of a lidar that this version does not know: "
                f"{status.about.info.family or 'nothing'}",
                reason="source",
            )
        family = FAMILIES[0]  # nothing of it is used but its times
    if raw and family.stream_in(began.mode) is None:
        raise ConnectFailed(
            f"zenoh:{key} sends packets of an unknown type, 0x{began.mode.response_type:02X}", reason="source"
        )
    streams = RemoteStreams(family, status.about, status.modes, began, raw=raw)
    port = RemotePort(bus, key, streams, _gid_of(status))
    bus.subscribe(status_key(key), port.learn)
    bus.watch_tokens(tokens_of(key), port.token_changed)
    bus.subscribe(key, port.receive)
    return port, family, RemoteDevice(streams)


def _gid_of(status: Status) -> bytes:
    """What tells the publisher of a status; it may write anything there."""
    try:
        return bytes.fromhex(status.sender)
    except ValueError:
        return b""
