"""The configuration values of an RPLIDAR (GET_LIDAR_CONF), above all its scan modes.

S-series interface manual, GET_LIDAR_CONF. Every value comes in a response of its own, which can be lost or damaged.
So each value is asked for until two responses are equal. For a list of modes, no more values are asked for after
four that did not come or were never equal. The next call for the list, or for a value, asks again.

The network address of an Ethernet model can be set, too (SDK 2.1.0, `frame_grabber`). The value has twelve bytes:
address, mask and gateway, in network order; with all zero, the device asks the network for an address (DHCP). It
uses a new address after a reset. Firmware that does not know this value responds with fewer bytes, or not at all.
"""

import math
import struct
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from ipaddress import AddressValueError, IPv4Address
from typing import Final

from lidario.basics.arguments import printable
from lidario.basics.model import NetworkAddress, ScanMode
from lidario.errors import InvalidValue, RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Script
from lidario.families.rplidar import commands
from lidario.families.rplidar.commands import Conf
from lidario.families.rplidar.formats import FORMATS
from lidario.families.scripts import agreed
from lidario.wire.envelope import Request

MODE_LIMIT: Final = 64  # mode numbers that are tried; devices have two to five modes, numbered from 0, with gaps
SHORT_S: Final = 0.15  # a healthy device responds within a few milliseconds
MOST_IN_VAIN: Final = 4
"""After this many values that the device did not tell, no more of the list of modes are asked for, nor is the
typical speed. Each silence takes 1 s."""
_NO_ADDRESS: Final = "this device tells no network address: is it an Ethernet model?"


class Configuration:
    """The values of one device; while `known` is False, no value is asked for."""

    def __init__(self) -> None:
        self.known = False
        self._untold: Counter[Conf] = Counter()  # how often the device was asked in vain for each value

    def value(self, kind: Conf, most_in_vain: float = math.inf) -> Script[bytes | None]:
        """One value; empty if the device does not have it, None if it does not tell it.

        A device that was silent before may not know the question. It is asked with a short timeout, so that no
        stream waits for long. After `most_in_vain` silences it is not asked again; this is for values on which only
        a first guess depends.
        """
        if self._untold[kind] >= most_in_vain:
            return None
        request = commands.get_lidar_conf(kind)
        if self._untold[kind]:
            request = replace(request, timeout=SHORT_S, attempts=1)
        value = yield from self._value(request)
        self._untold[kind] += value is None
        return value

    def _value(self, request: Request) -> Script[bytes | None]:
        if not self.known:
            return b""
        try:
            told = yield request
            # A shorter response says that the device has no such value. Damage does not make a response shorter.
            return (yield from agreed(request, told))[4:] if told[4:] else b""
        except (ResponseTimeout, RemoteProtocolError):
            return None

    def modes(self) -> Script[tuple[tuple[ScanMode, ...], str]]:
        """The modes that the device lists, by number, and a note about modes that it did not tell."""
        self._in_vain = 0
        found: dict[int, ScanMode] = {}
        count = (yield from self._ask(2, Conf.MODE_COUNT)) or 0
        unsure: Iterable[int] = range(MODE_LIMIT)
        for _ in range(2):  # again, for the line may have damaged values
            unsure = yield from self._list(unsure, count, found)
        if not found:
            return (), "the device did not tell its scan modes; those of older firmware are assumed"
        typical = yield from self._ask(2, Conf.TYPICAL_MODE)
        if typical is None:
            typical = yield from self._ask(2, Conf.TYPICAL_MODE)
        modes = [found[number] for number in sorted(found)]
        usable = [mode.id for mode in modes if mode.response_type in FORMATS]
        if typical not in usable:
            typical = usable[-1] if usable else None
        is_short = len(found) < count or not found.keys().isdisjoint(unsure)
        note = "the device did not tell all of its scan modes" if is_short else ""
        return tuple(replace(mode, typical=mode.id == typical) for mode in modes), note

    def _list(self, numbers: Iterable[int], count: int, found: dict[int, ScanMode]) -> Script[list[int]]:
        """Ask for modes until `count` are found; returns the numbers of those with a value that was not told."""
        unsure: list[int] = []
        for number in numbers:
            in_vain = self._in_vain
            if in_vain >= MOST_IN_VAIN or (number not in found and len(found) >= count):
                continue
            told = yield from self._mode(number)
            # Numbers may have gaps: a number for which the device tells nothing is no mode.
            if told.response_type:
                found[number] = told
            if self._in_vain > in_vain:
                unsure.append(number)
        return unsure

    def _mode(self, mode: int) -> Script[ScanMode]:
        response_type = yield from self._ask(1, Conf.RESPONSE_TYPE, mode)
        if not response_type:
            return ScanMode(mode, "", 0.0, 0.0, 0)
        name = (yield from self._of_list(Conf.MODE_NAME, mode)) or b""
        sample_q8 = yield from self._ask(4, Conf.SAMPLE_DURATION, mode)
        distance_q8 = yield from self._ask(4, Conf.MAX_DISTANCE, mode)
        return ScanMode(
            id=mode,
            name=_text(name) or f"mode {mode}",
            sample_us=(sample_q8 or 0) / 256,
            max_distance=(distance_q8 or 0) / 256,
            response_type=response_type,
        )

    def _of_list(self, kind: Conf, mode: int | None) -> Script[bytes | None]:
        """As `value`, for the list of modes; None without asking if too many values of the list were not told."""
        if self._in_vain >= MOST_IN_VAIN:
            return None
        value = yield from self._value(commands.get_lidar_conf(kind, mode))
        self._in_vain += value is None
        return value

    def _ask(self, size: int, kind: Conf, mode: int | None = None) -> Script[int | None]:
        """One number of `size` bytes; None if the device does not have it or does not tell it."""
        value = yield from self._of_list(kind, mode)
        return None if value is None or len(value) < size else int.from_bytes(value[:size], "little")


def _text(raw: bytes) -> str:
    """A name from the device, without what could disturb a terminal."""
    return printable(raw.split(b"\0")[0].decode("utf-8", "replace")).strip()


def ask_address() -> Script[NetworkAddress]:
    """Ask for the network address. Raises Unsupported if the device tells none."""
    try:
        # The type is followed by two zero bytes.
        told = (yield from agreed(commands.get_lidar_conf(Conf.NETWORK_ADDRESS, 0)))[4:]
    except ResponseTimeout as error:
        raise Unsupported(_NO_ADDRESS) from error
    if len(told) < 12:
        raise Unsupported(_NO_ADDRESS)
    return NetworkAddress(*(str(IPv4Address(told[at : at + 4])) for at in (0, 4, 8)))


def set_address(wanted: NetworkAddress) -> Script[None]:
    """Set another network address, as `Device.set_network_address`."""
    if not isinstance(wanted, NetworkAddress):
        raise InvalidValue(f"a network address is a NetworkAddress, not {type(wanted).__name__}")
    try:
        # As text, since `IPv4Address` would accept a number, too.
        parts = [IPv4Address(str(text)).packed for text in (wanted.address, wanted.mask, wanted.gateway)]
    except AddressValueError as error:
        raise InvalidValue(f"not an IPv4 address: {error}") from None
    value = b"".join(parts) if any(parts[0]) else bytes(12)
    try:
        response = yield commands.set_lidar_conf(Conf.NETWORK_ADDRESS, value)
    except ResponseTimeout as error:
        raise Unsupported(_NO_ADDRESS) from error
    result = struct.unpack_from("<I", response, 4)[0]
    if result:
        raise RemoteProtocolError(f"the device refuses this network address: result 0x{result:08X}")
