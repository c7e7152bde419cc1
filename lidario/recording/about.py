"""What stands at the beginning of a recording: which device, how it was opened, and what it had said by then.

It is one metadata record of the file, named `NAME`, whose values are all texts. A reader may be given a file by
anybody, so `About.of` takes whatever is there and replaces what cannot be right.
"""

import re
from dataclasses import asdict, dataclass, field
from typing import Self

from lidario.basics.arguments import printable
from lidario.basics.model import DeviceInfo, Health, HealthStatus
from lidario.recording.chronicle import MOST_NS, MOST_RESPONSES, StreamBegan, StreamEvent, event_of, text_of

NAME = "lidario"
FORMAT = "1"
LONGEST_TEXT = 200
MOST_EVENTS = MOST_RESPONSES + 1
"""All responses, and the stream that runs."""
_WHOLE = re.compile(r"-?[0-9]{1,19}")
_AS_IT_IS = ("source", "baudrate", "clock_offset_ns", "received_before", "recording", "began_ns")
NOT_TOLD = Health(HealthStatus.WARNING, 0, "the recording does not tell")


@dataclass(frozen=True, slots=True)
class About:
    """The beginning of a recording."""

    info: DeviceInfo  # what the device said it is
    health: Health = NOT_TOLD  # what it last said of its state before the recording began
    source: str = ""  # the source it was opened from
    baudrate: int = 0  # speed of the line; 0 where bytes take no time
    clock_offset_ns: int = 0  # what is added to the monotonic clock to get the time stamps of the file
    received_before: int = 0  # bytes received since the port was opened, before the first one of the file
    lidario: str = ""  # version that wrote it
    recording: str = ""  # digits that all files of one recording have in common; empty in those of older versions
    began_ns: int = 0  # when the file was begun, on the clock of the file; 0 where that is not told
    # What the device had responded by then, and the stream that ran, if one did.
    events: tuple[StreamEvent, ...] = field(default=())

    @property
    def running(self) -> StreamBegan | None:
        """The stream that ran; None where none did."""
        return next((event for event in self.events if isinstance(event, StreamBegan)), None)

    def as_texts(self) -> dict[str, str]:
        """The metadata record."""
        info, health = self.info, self.health
        told = {
            "format": FORMAT,
            "lidario": self.lidario,
            **asdict(info),
            "health": health.status.value,
            "health_code": health.code,
            **{name: getattr(self, name) for name in _AS_IT_IS},
            "events": "\n".join(text_of(event) for event in self.events),
        }
        # The name of a port or a file may hold bytes that are no text.
        return {name: str(value).encode("utf-8", "replace").decode() for name, value in told.items()}

    @classmethod
    def of(cls, texts: dict[str, str]) -> Self:
        """What `as_texts` wrote; what is missing or cannot be right is empty."""

        def text(name: str) -> str:
            return printable(texts.get(name, ""), LONGEST_TEXT)

        def number(name: str, least: int = 0) -> int:
            digits = _WHOLE.fullmatch(texts.get(name, ""))
            return max(min(int(digits[0]), MOST_NS), least) if digits else 0

        status = next((each for each in HealthStatus if each.value == text("health")), None)
        lines = texts.get("events", "").split("\n", MOST_EVENTS)[:MOST_EVENTS]
        events = (event_of(line) for line in lines)
        return cls(
            DeviceInfo(
                text("family"), text("model"), number("model_id"), text("firmware"), number("hardware"),
                text("serial"),
            ),
            NOT_TOLD if status is None else Health(status, number("health_code")),
            source=text("source"),
            baudrate=number("baudrate"),
            clock_offset_ns=number("clock_offset_ns", -MOST_NS),
            received_before=number("received_before"),
            lidario=text("lidario"),
            recording=text("recording"),
            began_ns=number("began_ns"),
            events=tuple(event for event in events if event is not None),
        )  # fmt: skip
