"""``lidario doctor``: everything that commonly keeps a lidar from working, each line ok or with its cure.

First the machine, which can be examined without a device: brltty and ModemManager, which take serial ports for
braille displays and modems, and the machine's own supply. Then each port: its adapter, its access, and what
responds there at which speed. At last what responds is asked for its health and for a second of scans.

The exit code is the one that `lidario scan` would end with.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import Literal

import click

import lidario
from lidario.cli.errors import ExitCode, exit_code
from lidario.cli.machine import Machine
from lidario.cli.output import dump, emit_tables, introduced, judged
from lidario.cli.parameters import source_argument
from lidario.cli.running import run
from lidario.cli.stats import Measured, measure, percent, verdict
from lidario.cli.udev import is_unique
from lidario.families.adapters import ADAPTERS

SCAN_S = 1.0
SLOW_LATENCY_MS = 4
"""An FTDI adapter gathers for 16 ms unless it is told otherwise; a revolution takes 100 ms."""
_RULES = "lidario udev | sudo tee /etc/udev/rules.d/99-lidar.rules"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line: what was examined, and what was found.

    `state` is ``hint`` for what may cause trouble, ``bad`` for what does; `port` is empty for the machine itself.
    """

    what: str
    state: Literal["ok", "hint", "bad"]
    text: str
    cure: str = ""
    port: str = ""


@click.command()
@source_argument
@click.option("--json", "as_json", is_flag=True, help="A list for programs.")
def doctor(source: str, as_json: bool) -> int:
    """Find out why a lidar does not work, and the cure.

    This machine, its ports and the lidars on them are examined. Asking a device that scans stops it. Without a
    SOURCE all ports are examined whose adapter is a kind that lidars are sold with.
    """
    machine = Machine()
    ports = lidario.list_serial_ports()
    adapters = [port for port in ports if port.adapter]
    findings = list(of_machine(machine, [port.path for port in adapters]))
    named = source not in ("", "auto")
    sources = [source] if named else [port.path for port in adapters]
    by_path = {port.path: port for port in ports}
    codes: list[int] = []
    for each in sources:
        if each in by_path:
            findings += of_adapter(machine, by_path[each])
        found, code = run(partial(_of_device, machine, each, by_path.get(each)), f"asking {each} …")
        findings += found
        codes.append(code)
    if not sources:
        findings.append(_nothing_plugged(ports))
        codes = [ExitCode.NO_DEVICE]
    if as_json:
        dump([asdict(finding) for finding in findings])
    else:
        emit_tables(judged(_rows(findings)))
    # Several ports, and a lidar on one of them: that one is what `auto` opens.
    return ExitCode.OK if ExitCode.OK in codes else codes[0]


def of_machine(machine: Machine, ports: list[str]) -> Iterator[Finding]:
    """What programs and supply of the machine mean for ports such as these; nothing is opened."""
    numbers = [(usb.vendor, usb.product) for usb in map(machine.usb, ports) if usb is not None]
    if not numbers:
        # The adapter may be missing just because brltty has taken it.
        numbers = [(f"{each.vendor:04x}", f"{each.product:04x}") for each in ADAPTERS.values()]
    claimed = [pair for pair in numbers if machine.brltty_claims(*pair)]
    if all(machine.brltty_is_kept_off(*pair) for pair in claimed):
        text = "is kept from such adapters by a rule" if claimed else "does not take such adapters"
        yield Finding("brltty", "ok", text)
    else:
        yield Finding(
            "brltty", "bad", "takes the adapter for a braille display, and its port disappears",
            f"{_RULES}   and plug it in again;\n"
            "or sudo apt remove brltty   where no braille display is in use",
        )  # fmt: skip
    if not machine.runs("ModemManager"):
        yield Finding("ModemManager", "ok", "does not run")
    elif ports and all(map(machine.is_no_modem, ports)):
        yield Finding("ModemManager", "ok", "runs, and a rule keeps it from the port")
    else:
        text = "runs, and writes to new ports for some seconds to find a modem"
        yield Finding("ModemManager", "hint", text, f"{_RULES}   tells it to leave the port alone")
    if machine.is_undervolted():
        cure = "a stronger supply, or a powered USB hub for the lidar (5 V, 1.5 A when its motor starts)"
        yield Finding("power", "bad", "the supply of this machine has fallen too low", cure)


def of_adapter(machine: Machine, port: lidario.PortInfo) -> Iterator[Finding]:
    """What the adapter behind a port is, and whether its name stays the same; nothing is opened."""
    usb = machine.usb(port.path)
    if not port.adapter:
        text = f"{port.description or 'unknown'}: lidars are not sold with it"
        yield Finding("adapter", "hint", text, port=port.path)
        return
    fastest = ADAPTERS[port.adapter].fastest
    speed = f", up to {fastest} baud" if fastest else ""
    yield Finding("adapter", "ok", port.adapter + speed, port=port.path)
    if usb is None:
        return
    if usb.sleeps:
        text = "the system may let the adapter sleep while no program has it open"
        yield Finding("power", "hint", text, f"{_RULES}   keeps it awake", port.path)
    if is_unique(usb.serial):
        yield Finding("name", "ok", port.by_id or "the adapter has a serial number of its own", port=port.path)
    else:
        text = "the adapter has no serial number of its own: two such lidars may swap names"
        cure = f"lidario udev {port.path} --name front   or open it as id:SERIAL"
        yield Finding("name", "hint", text, cure, port.path)


async def _of_device(machine: Machine, source: str, port: lidario.PortInfo | None) -> tuple[list[Finding], int]:
    """What responds there, and the exit code that `lidario scan` would end with."""
    found: list[Finding] = []
    before = machine.latency_ms(source)
    try:
        async with lidario.open_lidar(source) as lidar:
            at = f" at {lidar.baudrate} baud" if lidar.baudrate else ""
            found.append(Finding("access", "ok", "may be opened, and no other program holds it", port=source))
            name = introduced(lidar.info.model, lidar.info.serial, lidar.info.firmware)
            found.append(Finding("response", "ok", f"{name}{at}", port=source))
            fastest = ADAPTERS[port.adapter].fastest if port is not None and port.adapter else 0
            if 0 < fastest < lidar.baudrate:
                text = f"{lidar.baudrate} baud is more than the adapter is made for ({fastest})"
                found.append(Finding("speed", "hint", text, "an adapter that is made for it", source))
            found += _of_latency(before, machine.latency_ms(source), source)
            note = f": {lidar.health.note}" if lidar.health.note else ""
            is_fine = lidar.health.status.value == "ok"
            text = f"ok{note}" if is_fine else f"{lidar.health.status.value}, code {lidar.health.code}{note}"
            found.append(Finding("health", "ok" if is_fine else "hint", text, port=source))
        found += await _of_scans(source)
    except lidario.LidarError as error:
        found.append(_failed(source, error))
        return found, exit_code(error)
    return found, ExitCode.OK


def _of_latency(before: int | None, during: int | None, source: str) -> Iterator[Finding]:
    """How long the adapter gathered bytes before it was opened, and while it was open."""
    if before is None or during is None:
        return
    text = f"the adapter gathers bytes for {during} ms"
    if during > SLOW_LATENCY_MS:
        cure = f"{_RULES}   makes it 1 ms"
        yield Finding("latency", "hint", f"{text}, so that scans come late by as much", cure, source)
    else:
        text += f" while lidario has it open, else for {before} ms" if before > during else ""
        yield Finding("latency", "ok", text, port=source)


async def _of_scans(source: str) -> list[Finding]:
    measured = Measured()
    await measure(source, SCAN_S, None, measured)
    word, reason = verdict(measured)
    rate = f"{measured.hertz:.1f} Hz, " if measured.periods else ""
    samples = sum(measured.samples) // max(len(measured.samples), 1)
    text = f"{rate}{samples} samples a scan, {percent(measured.no_return)} without a return"
    if word == "good":
        found = [Finding("scans", "ok", text, port=source)]
    else:
        found = [Finding("scans", "bad" if word == "damaged" else "hint", f"{word}: {text}", reason, source)]
    if measured.line.line_trouble:
        found.append(Finding("driver", "hint", f"counted {measured.line.line_trouble}", port=source))
    return found


def _failed(source: str, error: lidario.LidarError) -> Finding:
    """The text of an error has the cause in its first line and the cure behind it."""
    reason = error.reason if isinstance(error, lidario.ConnectFailed) else ""
    what = {"permission": "access", "busy": "access", "missing": "port", "source": "source", "refused": "port"}
    text, _, cure = str(error).partition("\n")
    if not cure and reason == "silent":
        cure = "power (5 V, 1.5 A when the motor starts), cable, and the adapter's speed switch"
    where = "health" if isinstance(error, lidario.DeviceFault) else what.get(reason, "response")
    return Finding(where, "bad", text, cure, source)


def _nothing_plugged(ports: list[lidario.PortInfo]) -> Finding:
    others = ", ".join(port.path for port in ports)
    cure = "plug it in; `sudo dmesg | tail` tells whether the system sees it, or whether a cable only carries power"
    if others:
        cure = f"lidario doctor {ports[0].path}   examines a port that is there ({others}); else " + cure
    return Finding("port", "bad", "no port has an adapter that lidars are sold with", cure)


def _rows(findings: list[Finding]) -> Iterator[tuple[str, str, str, str]]:
    colours = {"ok": "green", "hint": "yellow", "bad": "bold red"}
    place = ""
    for finding in findings:
        if finding.port != place:
            place = finding.port
            yield "bold", "", "", place
        yield colours[finding.state], finding.state, finding.what, finding.text
        if finding.cure:
            yield "", "", "", "→ " + finding.cure.replace("\n", "\n  ")
