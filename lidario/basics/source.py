"""The text that says where scans come from: a port, a network address, a simulator.

=====================================================  ====================================================
``auto``                                               the only lidar that responds
``/dev/ttyUSB0``, ``COM3``                             a serial port; family and baud rate by probing
``serial:///dev/ttyUSB0?model=NAME``                   a model that cannot tell its own name
``serial:///dev/ttyUSB0?baud=1000000&family=NAME``     a serial port, nothing probed
``id:SERIAL``                                          by the lidar's own serial number
``tcp://host:port``, ``socket://host:port``            serial over TCP
``udp://host:port``                                    an Ethernet model
``sim://MODEL?world=room&fault=drop:1%``               the simulator, its bytes through the real decoder
``run.mcap?from=90``, ``raw.bin?rate=10&loop=1``       a recording, at true pace unless ``rate`` says otherwise
``zenoh:KEY?router=tcp/host:7447``                     another machine's lidar, as ``lidario publish`` sends it
=====================================================  ====================================================

This module reads the form only. Whether a family or a simulated model of that name exists is known to
`lidario.families.registry.check_source`.

The text may come from outside (a command line, a configuration file). Therefore every text is either a source or
refused with `ConnectFailed`, everything that a later step could not handle (NUL in a path, a host name that cannot
be encoded, a baud rate that does not fit) is refused here, and messages show the text with ``repr``.
"""

import os
import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qsl, unquote, urlsplit

from lidario.basics.arguments import path_of, shown
from lidario.errors import ConnectFailed, InvalidValue

if TYPE_CHECKING:
    from lidario.sim.device import SimulatedDevice

_OPTIONS = {
    "serial": {"baud", "family", "model"},
    "tcp": {"baud", "family", "model"},
    "udp": {"family"},
    "zenoh": {"router"},
    "file": {"rate", "loop", "from", "family", "model", "sample_us"},
    "sim": {"world", "pose", "fault", "serial", "seed", "via", "baud", "family", "model"},
}
MOST_BAUD = 100_000_000
"""Far above every adapter (12 Mbaud), and below what overflows the C integer that the system call takes."""
_POSE = re.compile(r"(-?[0-9]{1,3}(\.[0-9]{1,6})?)(,-?[0-9]{1,3}(\.[0-9]{1,6})?){2}", re.ASCII)
_MAX_SEED = 2**63 - 1
_DECIMAL = re.compile(r"[0-9]{1,9}(\.[0-9]{1,9})?", re.ASCII)
_UNPRINTABLE = {"Cc", "Cf", "Zl", "Zp"}
"""Unicode categories that can change what a terminal shows; no port, host or model is called so."""
_FILES = (".mcap", ".bin")  # how the name of a recording ends
_MOST_RATE = 1e6
_EXAMPLES = {"tcp": "192.168.0.7:20108", "udp": "192.168.11.2:8089"}
"""Addresses that lidars, and bridges to them, come with."""
_KNOWN = (
    "Known are a port (/dev/ttyUSB0, COM3), serial://, tcp://, udp://, sim://, id:SERIAL, zenoh:KEY, and a "
    "recording (.mcap, .bin)"
)
_SHOWN = 120  # longest part of a source that is repeated in a message


@dataclass(frozen=True, slots=True)
class Source:
    """A source, parsed."""

    text: str  # as the user wrote it
    kind: str  # ``auto``, ``serial``, ``tcp``, ``udp``, ``sim``, ``id``, ``file`` or ``zenoh``
    address: str = ""  # path, ``host:port``, model, serial number or key; empty for ``auto``
    options: Mapping[str, str] = field(default_factory=dict)  # the options after the question mark
    device: "SimulatedDevice | None" = None  # a simulated device to connect to in memory; its kind is ``device``

    @property
    def baudrate(self) -> int | None:
        """The baud rate that was asked for, if any."""
        return int(self.options["baud"]) if "baud" in self.options else None

    @property
    def family(self) -> str | None:
        """The family that was named, if any."""
        return self.options.get("family")

    @property
    def model(self) -> str | None:
        """The model that was named, in lower case, if any."""
        return self.options["model"].casefold() if "model" in self.options else None

    @property
    def is_driven_from_here(self) -> bool:
        """Whether a device may be there that this program drives, and that goes on when the program dies."""
        return self.kind in ("serial", "tcp", "udp", "auto", "id")

    @property
    def rate(self) -> float:
        """How many times as fast as it was recorded a file is played; 0 for as fast as it is read."""
        return float(self.options.get("rate", "1"))

    @property
    def begin_s(self) -> float:
        """Seconds behind its beginning from where on a file is played the first time."""
        return float(self.options.get("from", "0"))

    @property
    def host_and_port(self) -> tuple[str, int]:
        """Host and port of a network address."""
        parts = urlsplit(f"//{self.address}")
        return parts.hostname or "", parts.port or 0


def as_source(source: "str | os.PathLike[str] | SimulatedDevice") -> Source:
    """Parse what a user may name as a source: a text, the path of a serial port or recording, a simulated device.

    Raises as `parse_source`, and InvalidValue where it is none of the three.
    """
    if isinstance(source, str):
        return parse_source(source)
    if isinstance(source, os.PathLike):
        path = str(path_of(source, "a source"))
        return _checked(Source(path, "file" if path.casefold().endswith(_FILES) else "serial", path))
    if not all(callable(getattr(source, name, None)) for name in ("receive", "transmit", "wakeup")):
        raise InvalidValue(f"a source is a text, a path or a simulated device, not {shown(source)}")
    return Source("simulated", "device", device=source)


def parse_source(text: str) -> Source:
    """Parse the text of a source.

    Raises:
        ConnectFailed: With reason ``source``, when the text is not a source; the message says why.
    """
    if text in ("", "auto"):
        return Source(text or "auto", "auto")
    if text.startswith("id:"):
        return _checked(Source(text, "id", text[3:]))
    if text.startswith("zenoh:"):
        key, _, query = text[6:].removeprefix("//").partition("?")
        return _checked(Source(text, "zenoh", key, _options(text, "zenoh", query)))
    if text.startswith("sim:") and not text.startswith("sim://"):
        meant = _printable(text[4:].strip("/"))
        raise _refused(text, f"is not a source: a simulated lidar has two slashes, as in sim://{meant}")
    if "://" not in text:
        name, _, query = text.partition("?")
        if name.casefold().endswith(_FILES):
            return _checked(Source(text, "file", name, _options(text, "file", query)))
        return _checked(Source(text, "serial", text))
    return _parse_url(text)


def _parse_url(text: str) -> Source:
    """As `parse_source`, of a text that has a scheme."""
    try:
        # '#' may be part of a port's name, so nothing is split off there.
        parts = urlsplit(text, allow_fragments=False)
    except ValueError as error:
        raise _refused(text, "cannot be read. IPv6 addresses stand in brackets, as in tcp://[::1]:2000") from error
    kind = {"socket": "tcp"}.get(parts.scheme, parts.scheme)
    if kind not in _OPTIONS:
        raise _refused(text, f"is not a source: {parts.scheme}:// is not known. {_KNOWN}")
    options = _options(text, kind, parts.query)
    if kind in ("serial", "file"):
        # ``serial:///dev/x`` names /dev/x, ``serial://COM3`` names COM3; a desktop writes files likewise.
        address = parts.netloc or parts.path
        if parts.netloc and parts.path:
            meant = _printable(parts.netloc + parts.path)
            raise _refused(text, f"cannot be read: write the path with three slashes, as in {kind}:///{meant}")
    else:
        address = parts.netloc
        if parts.path.strip("/"):
            raise _refused(text, f"cannot be read: nothing may follow {quoted(address)} but options after '?'")
    return _checked(Source(text, kind, unquote(address), options))


def _options(text: str, kind: str, query: str) -> dict[str, str]:
    options: dict[str, str] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        if name not in _OPTIONS[kind]:
            known = ", ".join(sorted(_OPTIONS[kind]))
            owner = {"file": "a recording", "zenoh": "zenoh:"}.get(kind, f"{kind}://")
            raise _refused(text, f"has an option that {owner} does not know: {quoted(name)}. It knows {known}")
        if name in options:
            raise _refused(text, f"cannot be read: the option {quoted(name)} is given twice")
        options[name] = value
    for name, value in options.items():
        fits, what = _VALUES.get(name, (None, ""))
        if fits is not None and not fits(value):
            raise _refused(text, f"cannot be read: {name}={quoted(value)} is not {what}")
    return options


def _number(digits: str) -> int:
    """The number in ASCII digits, else -1; int() would also take signs, spaces and digits of other scripts."""
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) < 20 else -1


def _is_decimal(digits: str) -> bool:
    """Whether it is a number in ASCII digits, with or without a point, that is not too large."""
    return bool(_DECIMAL.fullmatch(digits)) and float(digits) <= _MOST_RATE


_VALUES: Final[dict[str, tuple[Callable[[str], bool], str]]] = {
    "baud": (lambda value: 0 < _number(value) <= MOST_BAUD, "a number of bits per second, such as 115200"),
    "rate": (_is_decimal, "a number from 0 on"),
    "from": (_is_decimal, "a number from 0 on"),
    "sample_us": (_is_decimal, "a number from 0 on"),
    "loop": (lambda value: value in ("0", "1"), "1, to play it again and again, or 0, to play it once"),
    "pose": (lambda value: bool(_POSE.fullmatch(value)), "x,y,degrees, as in pose=0.3,0,90"),
    "via": (lambda value: value in ("pty", "tcp", "udp", "memory"), "pty, tcp, udp or memory"),
    "seed": (lambda value: 0 <= _number(value) <= _MAX_SEED, "a whole number from 0 on"),
}
"""Which values an option may have, and how they are called."""


def _checked(source: Source) -> Source:
    for text in (source.address, *source.options.values()):
        if any(unicodedata.category(char) in _UNPRINTABLE for char in text):
            raise _refused(source.text, "contains a control character")
    # sim:// without a model is refused by the registry, which can list the models.
    if not source.address and source.kind != "sim":
        raise _refused(source.text, "names nothing to open")
    names_file = source.kind in ("serial", "file")
    try:
        # Names of files have the encoding of the system, which may be ASCII; everything else is sent as UTF-8.
        if names_file:
            os.fsencode(source.address)
        else:
            source.address.encode()
    except UnicodeError as error:
        what = "a character that cannot stand in a file name" if names_file else "something that is no character"
        raise _refused(source.text, f"contains {what}") from error
    if source.kind in _EXAMPLES:
        _check_host(source)
    return source


def _check_host(source: Source) -> None:
    try:
        host, port = source.host_and_port
    except ValueError:
        host, port = "", 0
    if not host or not port or "@" in source.address:
        raise _refused(source.text, f"needs a host and a port, as in {source.kind}://{_EXAMPLES[source.kind]}")
    try:
        # The resolver encodes the name in the same way, and raises UnicodeError while connecting.
        host.encode("idna")
    except UnicodeError as error:
        raise _refused(source.text, f"has a host name that cannot be one: {quoted(host)}") from error


def _refused(text: str, why: str) -> ConnectFailed:
    return ConnectFailed(f"{quoted(text)} {why}", reason="source")


def quoted(text: str) -> str:
    """A word of the user's in quotes, for an error text: no more than its beginning, and nothing unprintable."""
    return repr(text if len(text) <= _SHOWN else text[:_SHOWN] + "…")


def _printable(text: str) -> str:
    return quoted(text)[1:-1]
