"""The one word that says where scans come from: a port, a network address, a simulator.

=====================================================  ====================================================
``auto``                                               the only lidar that answers
``/dev/ttyUSB0``, ``COM3``                             a serial port; family and baud rate by probing
``serial:///dev/ttyUSB0?baud=1000000&family=NAME``     a serial port, nothing probed
``id:SERIAL``                                          by the lidar's own serial number
``tcp://host:port``, ``socket://host:port``            serial over TCP
``sim://MODEL?world=room&fault=drop:1%``               the simulator, its bytes through the real decoder
=====================================================  ====================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, unquote, urlsplit

from lidario.errors import ConnectFailed

if TYPE_CHECKING:
    from lidario.sim.device import SimulatedDevice

__all__ = ["Source", "parse_source"]

_OPTIONS = {
    "serial": {"baud", "family"},
    "tcp": {"baud", "family"},
    "sim": {"world", "fault", "serial", "seed", "via", "baud", "family"},
}


@dataclass(frozen=True, slots=True)
class Source:
    """A source, taken apart.

    Attributes:
        text: As the user wrote it.
        kind: ``auto``, ``serial``, ``tcp``, ``sim`` or ``id``.
        address: Path, ``host:port``, model or serial number; empty for ``auto``.
        options: What stood behind the question mark.
        device: A simulated device to connect to in memory; its kind is ``device``.
    """

    text: str
    kind: str
    address: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    device: SimulatedDevice | None = None

    @property
    def baudrate(self) -> int | None:
        """The baud rate that was asked for, if any."""
        return int(self.options["baud"]) if "baud" in self.options else None

    @property
    def family(self) -> str | None:
        """The family that was named, if any."""
        return self.options.get("family")

    @property
    def host_and_port(self) -> tuple[str, int]:
        """The two halves of a network address."""
        parts = urlsplit(f"//{self.address}")
        return parts.hostname or "", parts.port or 0


def parse_source(text: str) -> Source:
    """Take a source apart.

    Raises:
        ConnectFailed: With reason ``source``, when it is none; the text says what is wrong with it.
    """
    if text in ("", "auto"):
        return Source(text or "auto", "auto")
    if text.startswith("id:"):
        return Source(text, "id", text[3:])
    if "://" not in text:
        return Source(text, "serial", text)
    parts = urlsplit(text)
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    kind = {"socket": "tcp"}.get(parts.scheme, parts.scheme)
    if kind not in _OPTIONS:
        raise ConnectFailed(
            f"{text!r} is no source: {parts.scheme}:// is not known. Use a serial port, serial://, tcp:// or sim://",
            reason="source",
        )
    unknown = sorted(set(options) - _OPTIONS[kind])
    if unknown:
        raise ConnectFailed(
            f"{text!r} has an option that {kind}:// does not know: {unknown[0]}. "
            f"It knows {', '.join(sorted(_OPTIONS[kind]))}",
            reason="source",
        )
    if "baud" in options and not (options["baud"].isdigit() and int(options["baud"])):
        raise ConnectFailed(f"{text!r}: baud={options['baud']} is not a number of bits a second", reason="source")
    address = unquote(parts.path) if kind == "serial" else unquote(parts.netloc)
    source = Source(text, kind, address, options)
    _check_address(source)
    return source


def _check_address(source: Source) -> None:
    if not source.address:
        raise ConnectFailed(f"{source.text!r} names nothing to open", reason="source")
    if source.kind == "tcp":
        try:
            host, port = source.host_and_port
        except ValueError:
            host, port = "", 0
        if not host or not port:
            raise ConnectFailed(
                f"{source.text!r} needs a host and a port, as in tcp://192.168.0.7:20108", reason="source"
            )
