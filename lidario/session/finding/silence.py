"""What was received from a device that did not respond: it tells what is wrong with it."""

from __future__ import annotations

from collections.abc import Sequence

from lidario.errors import ConnectFailed
from lidario.families.base import Family
from lidario.model import LineErrors
from lidario.session.finding.listening import KEPT, family_of_stream
from lidario.source import Source, quoted

_MOSTLY = 0.9


class ReceivedInSilence:
    """A tap that keeps the first bytes received while no response arrives.

    Attributes:
        total: Bytes received.
    """

    def __init__(self) -> None:
        self.total: int = 0
        self._kept = bytearray()

    def see(self, direction: str, data: bytes, now: int) -> None:  # noqa: ARG002
        """Count what came in, and keep its beginning."""
        if direction == "in":
            self.total += len(data)
            self._kept += data[: KEPT - len(self._kept)]

    def describe(self, errors: LineErrors, *, has_speed: bool = True) -> str:
        """In words: nothing, zeros, packets of some family, or garbage; a network has no wrong baud rate."""
        if not self.total:
            return "nothing came back"
        if self._kept.count(0) >= _MOSTLY * len(self._kept):
            return f"{self.total} bytes came back, nearly all zero, as from a line that floats or a wrong baud rate"
        family = family_of_stream(self._kept)
        if family is not None:
            return f"{self.total} bytes came back, {family.title} packets among them: it streams, but does not obey"
        if counted := errors.meaning():
            return f"{self.total} bytes of garbage came back, with {counted}"
        why = "at a wrong baud rate" if has_speed else "from no lidar"
        return f"{self.total} bytes of garbage came back, as {why}"

    def nothing_responds(
        self, source: Source, asked: Sequence[Family], speeds: Sequence[int], errors: LineErrors
    ) -> ConnectFailed:
        """The error that says who was asked, at which speeds in baud, and what came back; and a cure."""
        told = list(dict.fromkeys(str(speed) for speed in speeds))
        at = f" at {_either(told)} baud" if told and source.kind == "serial" else ""
        titles = _either(list(dict.fromkeys(each.title for each in asked)))
        cure = "Is the lidar powered (5 V, 1.5 A)"
        cure += ", and is this computer in its network" if source.kind == "udp" else ""
        cure += " and the adapter's speed switch right?" if source.kind == "serial" else "?"
        # Behind a serial line that is served over TCP there may be a wrong baud rate, too.
        errors = errors if len(told) == 1 else LineErrors()
        said = self.describe(errors, has_speed=source.kind != "udp")
        heard = family_of_stream(self._kept)
        if source.model is not None and heard is not None and heard in asked:
            said = f"{self.total} bytes came back, {heard.title} packets among them, but of another model than"
            said, cure = f"{said} {quoted(source.model)}", "Is ?model= right?"
        return ConnectFailed(
            f"{source.address} opened, but nothing responds{at} (asked as {titles}): {said}. {cure}",
            reason="silent",
        )


def _either(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
