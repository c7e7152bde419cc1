"""The network address of an Ethernet model: asked for and set.

Twelve bytes: address, mask and gateway, in network order; all zero makes the device ask the network for one
(DHCP). It takes a new one when it is reset, as the vendor's tool does it (SDK 2.1.0, `frame_grabber`). Firmware
that does not know it responds with fewer bytes, or not at all.
"""

from __future__ import annotations

import struct
from ipaddress import AddressValueError, IPv4Address
from typing import Final

from lidario.errors import InvalidValue, RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Script
from lidario.families.responses import agreed
from lidario.families.rplidar import commands
from lidario.families.rplidar.commands import Conf
from lidario.model import NetworkAddress

_SIZE: Final = 12
_NONE: Final = "this device tells no network address: is it an Ethernet model?"


def ask_address() -> Script[NetworkAddress]:
    """Ask for the address. Raises Unsupported where the device tells none."""
    try:
        # The type is followed by two zero bytes.
        told = (yield from agreed(commands.get_lidar_conf(Conf.NETWORK_ADDRESS, 0)))[4:]
    except ResponseTimeout as error:
        raise Unsupported(_NONE) from error
    if len(told) < _SIZE:
        raise Unsupported(_NONE)
    return NetworkAddress(*(str(IPv4Address(told[at : at + 4])) for at in (0, 4, 8)))


def set_address(wanted: NetworkAddress) -> Script[None]:
    """As `Device.set_network_address`."""
    value = _encoded(wanted)
    try:
        response = yield commands.set_lidar_conf(Conf.NETWORK_ADDRESS, value)
    except ResponseTimeout as error:
        raise Unsupported(_NONE) from error
    result = struct.unpack_from("<I", response, 4)[0]
    if result:
        raise RemoteProtocolError(f"the device refuses this network address: result 0x{result:08X}")


def _encoded(wanted: NetworkAddress) -> bytes:
    if not isinstance(wanted, NetworkAddress):
        raise InvalidValue(f"a network address is a NetworkAddress, not {type(wanted).__name__}")
    try:
        # A number would be taken for an address, too.
        parts = [IPv4Address(str(text)).packed for text in (wanted.address, wanted.mask, wanted.gateway)]
    except AddressValueError as error:
        raise InvalidValue(f"not an IPv4 address: {error}") from None
    return b"".join(parts) if any(parts[0]) else bytes(_SIZE)
