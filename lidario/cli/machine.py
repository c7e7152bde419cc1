"""What the system says of itself and of a serial adapter: read from ``/proc``, ``/sys`` and ``/usr``.

All paths stand below `Machine.root`, so that a test can describe a machine as a folder. What cannot be read counts
as not there: other systems than Linux have none of it.
"""

import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

FIRST_OF_USERS: Final = 1000  # numbers of groups from there on are of users (`GID_MIN`)
KEEP_BRLTTY_OFF: Final = 'ENV{SYSTEMD_WANTS}=""'
"""In a rule of udev for a USB device: no service is started for it. brltty's own rules name brltty there."""


@dataclass(frozen=True, slots=True)
class Usb:
    """A USB device, as the system knows it."""

    vendor: str  # vendor number, four hexadecimal digits
    product: str  # product number, four hexadecimal digits
    serial: str  # the serial number of the adapter; empty where it has none
    place: str  # where it is plugged in, such as ``1-1.4``
    # For how long it gathers bytes before it sends them to the host; None where it does not tell.
    latency_ms: int | None
    sleeps: bool  # whether the system may let it sleep while no program has it open (autosuspend)


@dataclass(frozen=True, slots=True)
class Machine:
    """This machine; or a description of one: `root` is the folder in which ``etc``, ``proc`` and the like stand."""

    root: Path = Path("/")

    def runs(self, name: str) -> bool:
        """Whether a process of that name runs."""
        return any(_text(path) == name[:15] for path in self.root.glob("proc/[0-9]*/comm"))

    def brltty_claims(self, vendor: str, product: str) -> bool:
        """Whether brltty, a driver of braille displays, takes every adapter with these numbers for one."""
        # The kernel names a device so, without zeros in front.
        wanted = f'"{vendor.lstrip("0")}/{product.lstrip("0")}/'.casefold()
        return any(wanted in line.casefold() for line in self._rules("*brltty*"))

    def brltty_is_kept_off(self, vendor: str, product: str) -> bool:
        """Whether a rule of `lidario udev` keeps brltty from being started for adapters with these numbers."""
        wanted = (f'"{vendor}"'.casefold(), f'"{product}"'.casefold(), KEEP_BRLTTY_OFF.casefold())
        return any(all(word in line.casefold() for word in wanted) for line in self._rules("*"))

    def _rules(self, name: str) -> Iterator[str]:
        """Every rule of udev in files of that name, without comments. A file in ``etc`` hides one of its name."""
        files: dict[str, Path] = {}
        for folder in ("usr/lib/udev/rules.d", "lib/udev/rules.d", "etc/udev/rules.d"):
            files |= {path.name: path for path in self.root.glob(f"{folder}/{name}.rules")}
        for path in files.values():
            yield from (line for line in _text(path).splitlines() if not line.lstrip().startswith("#"))

    def is_no_modem(self, port: str) -> bool:
        """Whether udev has been told that ModemManager shall leave a port such as ``/dev/ttyUSB0`` alone."""
        told = _text(self.root / "run/udev/data" / f"c{_text(self._tty(port) / 'dev')}").splitlines()
        return any(f"E:{name}=1" in told for name in ("ID_MM_PORT_IGNORE", "ID_MM_DEVICE_IGNORE"))

    def is_undervolted(self) -> bool:
        """Whether a Raspberry Pi has seen its own supply fall too low."""
        names = self.root.glob("sys/class/hwmon/hwmon*/name")
        return any(_text(path.parent / "in0_lcrit_alarm") == "1" for path in names if _text(path) == "rpi_volt")

    def latency_ms(self, port: str) -> int | None:
        """As `Usb.latency_ms`, for a port such as ``/dev/ttyUSB0``: 1 while low latency is set."""
        told = _text(self._tty(port) / "device/latency_timer")
        return int(told) if told.isdecimal() else None

    def usb(self, port: str) -> Usb | None:
        """The adapter behind a port such as ``/dev/ttyUSB0``; None where there is none."""
        place = (self._tty(port) / "device").resolve()
        for folder in (place, *place.parents):
            if (folder / "idVendor").is_file():
                return Usb(
                    _text(folder / "idVendor").lower(),
                    _text(folder / "idProduct").lower(),
                    _text(folder / "serial"),
                    folder.name,
                    self.latency_ms(port),
                    _text(folder / "power/control") == "auto",
                )
        return None

    def access(self, port: str) -> str:
        """Who may open a port, and whether this user may; empty where it is not there. No user is named."""
        path = self.root / port.lstrip("/")
        try:
            found = path.stat()
        except OSError:
            return ""
        group = _group(found.st_gid)
        # Groups of users bear their names, those of the system are alike everywhere.
        of_group = f", group {group}" if group and found.st_gid < FIRST_OF_USERS else ""
        # Also by a list of users beside the mode, as desktops make one.
        may = "may" if os.access(path, os.R_OK | os.W_OK) else "may not"
        return f"{stat.filemode(found.st_mode)}{of_group}; this user {may} open it"

    def driver(self, port: str) -> str:
        """Name of the driver of the adapter, such as ``cp210x``; empty where none is told."""
        link = self._tty(port) / "device/driver"
        return link.resolve().name if link.exists() else ""

    def _tty(self, port: str) -> Path:
        return self.root / "sys/class/tty" / os.path.basename(os.path.realpath(port))


def _group(number: int) -> str:
    try:
        import grp  # not on Windows

        return grp.getgrgid(number).gr_name
    except (ImportError, KeyError):
        return ""


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
