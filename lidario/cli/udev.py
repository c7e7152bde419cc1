"""``lidario udev``: a rule that gives a lidar's port a name of its own, and its users access to it.

The rule is printed and never written. It finds the adapter by its serial number. Many adapters have none, or all
have the same one (``0001``); then the rule finds it by the socket that it is plugged into.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import click

from lidario.cli.errors import ExitCode
from lidario.cli.machine import ADAPTERS, Machine
from lidario.cli.output import dump
from lidario.cli.parameters import complete_source
from lidario.cli.streams import emit, message

if TYPE_CHECKING:
    from lidario.cli.machine import Usb

__all__ = ["is_unique", "rule_for", "udev"]

GROUP: Final = "dialout"
_FILE: Final = "/etc/udev/rules.d/99-lidar.rules"
_COMMON: Final = ("", "0", "1", "0001", "0000", "00000000", "123456", "12345678")
"""Serial numbers that adapters leave the factory with, thousands of them the same."""
_SAFE: Final = re.compile(r"[\w.:+-]+", re.ASCII)


@click.command()
@click.argument("port", required=False, shell_complete=complete_source)
@click.option("--name", default="lidar", show_default=True, metavar="NAME", help="Name below /dev.")
@click.option("--json", "as_json", is_flag=True, help="The rule and the name in one object.")
def udev(port: str | None, name: str, as_json: bool) -> int:
    """Print a udev rule for the port of a lidar; nothing is written.

    With one adapter plugged in, or PORT named, the rule is for that one. Otherwise it is for all adapters that
    lidars are sold with, and gives access but no name.
    """
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]{0,63}", name, re.ASCII):
        raise click.BadParameter(f"{name!r} cannot be the name of a device", param_hint="--name")
    machine = Machine()
    ports = [port] if port is not None else _plugged()
    found = machine.usb(ports[0]) if len(ports) == 1 else None
    if port is not None and found is None:
        from lidario import ConnectFailed

        raise ConnectFailed(f"{port} is not the port of a USB adapter that is plugged in", reason="missing")
    rule = general() if found is None else rule_for(found, name)
    if as_json:
        dump({"rule": rule, "name": f"/dev/{name}" if found else None, "port": ports[0] if found else None})
        return ExitCode.OK
    emit(rule)
    if found is None:
        number = len(ports) or "no"
        message(f"{number} adapters are plugged in: this is for all kinds")
        message("`lidario udev PORT --name front` makes a rule for one")
    message(f"to use it: lidario udev {port or ''} --name {name} | sudo tee {_FILE}".replace("  ", " "))
    message("           sudo udevadm control --reload && sudo udevadm trigger")
    return ExitCode.OK


def rule_for(usb: Usb, name: str) -> str:
    """The rule for one adapter, which is then also ``/dev/NAME``."""
    match = [_numbers(usb.vendor, usb.product)]
    why = "# By the serial number of its adapter.\n"
    if is_unique(usb.serial):
        match.append(f'ATTRS{{serial}}=="{usb.serial}"')
    else:
        match.append(f'KERNELS=="{usb.place}"')
        why = "# By the socket it is plugged into: the serial number of this adapter is not its own.\n"
    return why + ", ".join([*match, f'SYMLINK+="{name}"', *_access()]) + "\n"


def general() -> str:
    """The rules for every adapter that lidars are sold with: access, and no name."""
    numbers = [_numbers(f"{each.vendor:04x}", f"{each.product:04x}") for each in ADAPTERS.values()]
    lines = [", ".join([each, *_access()]) for each in numbers]
    return "# Adapters that lidars are sold with; other devices have them, too.\n" + "\n".join(lines) + "\n"


def is_unique(serial: str) -> bool:
    """Whether the serial number of an adapter is likely to be its own, and can stand in a rule."""
    return serial not in _COMMON and _SAFE.fullmatch(serial) is not None


def _numbers(vendor: str, product: str) -> str:
    return f'SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}"'


def _access() -> tuple[str, ...]:
    # ModemManager writes to every new port to find a modem there.
    return (f'GROUP="{GROUP}"', 'MODE="0660"', 'ENV{ID_MM_DEVICE_IGNORE}="1"')


def _plugged() -> list[str]:
    from lidario import list_serial_ports

    return [port.path for port in list_serial_ports() if port.adapter]
