"""``lidario udev``: rules that give a lidar's port a name of its own and its users access to it.

They find the adapter by its serial number. Many adapters have none, or all have the same one (``0001``); then they
find it by the socket that it is plugged into.
"""

import re
from collections.abc import Iterator
from typing import Final

import click

import lidario
from lidario.cli.machine import KEEP_BRLTTY_OFF, Machine, Usb
from lidario.cli.output import dump
from lidario.cli.parameters import complete_source
from lidario.cli.streams import emit, message
from lidario.families.adapters import ADAPTERS

GROUP: Final = "dialout"
FTDI: Final = 0x0403
"""The vendor number of the adapters whose driver has a latency timer."""
_FILE: Final = "/etc/udev/rules.d/99-lidar.rules"
_COMMON: Final = ("", "0", "1", "0001", "0000", "00000000", "123456", "12345678")
"""Serial numbers that adapters leave the factory with, thousands of them the same."""
_SAFE: Final = re.compile(r"[\w.:+-]+", re.ASCII)


@click.command()
@click.argument("port", required=False, shell_complete=complete_source)
@click.option("--name", default="lidar", show_default=True, metavar="NAME", help="Name below /dev.")
@click.option("--json", "as_json", is_flag=True, help="The rules and the name in one object.")
def udev(port: str | None, name: str, as_json: bool) -> None:
    """Print udev rules for the port of a lidar; nothing is written.

    With one adapter plugged in, or PORT named, they are for that one. Otherwise they are for all adapters that
    lidars are sold with, and give access but no name. They also keep the adapter awake and fast, and ModemManager
    and brltty off it.
    """
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]{0,63}", name, re.ASCII):
        raise click.BadParameter(f"{name!r} cannot be the name of a device", param_hint="--name")
    machine = Machine()
    ports = [port] if port is not None else [each.path for each in lidario.list_serial_ports() if each.adapter]
    found = machine.usb(ports[0]) if len(ports) == 1 else None
    if port is not None and found is None:
        raise lidario.ConnectFailed(f"{port} is not the port of a USB adapter that is plugged in", reason="missing")
    rule = general() if found is None else rule_for(found, name)
    if as_json:
        dump({"rule": rule, "name": f"/dev/{name}" if found else None, "port": ports[0] if found else None})
        return
    emit(rule)
    if found is None:
        number = len(ports) or "no"
        message(f"{number} adapters are plugged in: these are for all kinds")
        message("`lidario udev PORT --name front` makes rules for one")
    message(f"to use them: lidario udev {port or ''} --name {name} | sudo tee {_FILE}".replace("  ", " "))
    message("             sudo udevadm control --reload && sudo udevadm trigger")


def rule_for(usb: Usb, name: str) -> str:
    """The rules for one adapter, which is then also ``/dev/NAME``."""
    if is_unique(usb.serial):
        why = "# By the serial number of its adapter.\n"
        device, parent = f'ATTR{{serial}}=="{usb.serial}"', f'ATTRS{{serial}}=="{usb.serial}"'
    else:
        why = "# By the socket it is plugged into: the serial number of this adapter is not its own.\n"
        device, parent = f'KERNEL=="{usb.place}"', f'KERNELS=="{usb.place}"'
    timer = usb.latency_ms is not None
    return (
        why + "\n".join(_rules(usb.vendor, usb.product, device, parent, f'SYMLINK+="{name}"', timer=timer)) + "\n"
    )


def general() -> str:
    """The rules for every adapter that lidars are sold with: access, and no name."""
    lines: list[str] = []
    for each in ADAPTERS.values():
        lines += _rules(f"{each.vendor:04x}", f"{each.product:04x}", timer=each.vendor == FTDI)
    return "# Adapters that lidars are sold with; other devices have them, too.\n" + "\n".join(lines) + "\n"


def _rules(
    vendor: str, product: str, device: str = "", parent: str = "", link: str = "", *, timer: bool
) -> Iterator[str]:
    """The rules for adapters with these numbers, and with what `device`, or `parent` of its port, says."""
    numbers = f'ATTR{{idVendor}}=="{vendor}", ATTR{{idProduct}}=="{product}"'
    numbers_above = numbers.replace("ATTR{", "ATTRS{")
    # The adapter itself: always awake, no modem, and no service for it, since brltty takes some for a braille
    # display. ModemManager writes to every new port to find a modem there.
    yield _rule(
        'SUBSYSTEM=="usb"', numbers, device, 'ATTR{power/control}="on"', 'ENV{ID_MM_DEVICE_IGNORE}="1"',
        KEEP_BRLTTY_OFF,
    )  # fmt: skip
    if timer:
        # Not at the port: the timer is there when the driver has taken the adapter ("bind"), mostly not before.
        yield _rule('SUBSYSTEM=="usb-serial"', numbers_above, parent, 'ATTR{latency_timer}="1"')
    yield _rule(
        'SUBSYSTEM=="tty"', numbers_above, parent, link, f'GROUP="{GROUP}"', 'MODE="0660"',
        'ENV{ID_MM_PORT_IGNORE}="1"',
    )  # fmt: skip


def _rule(*parts: str) -> str:
    return ", ".join(part for part in parts if part)


def is_unique(serial: str) -> bool:
    """Whether the serial number of an adapter is likely to be its own, and can stand in a rule."""
    return serial not in _COMMON and _SAFE.fullmatch(serial) is not None
