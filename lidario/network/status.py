"""What a publisher tells of its lidar: once a second, and to everybody who asks.

It is one JSON object. `Status.of` takes whatever comes and replaces what cannot be right.
"""

import asyncio
import json
import math
from dataclasses import asdict, dataclass, replace
from typing import Final, Self

from lidario.basics.arguments import printable
from lidario.basics.model import ScanMode
from lidario.network.bus import Bus
from lidario.network.keys import status_key
from lidario.recording.about import About
from lidario.recording.chronicle import StreamBegan, mode_of

ASK_S: Final = 2.0
"""How long publishers have to respond. Where there is none, the router says so at once."""
LARGEST: Final = 1 << 18  # bytes of a status that is read; real ones have a few thousand
_MOST_MODES: Final = 64
_MOST_LETTERS: Final = 200
_SUFFIX: Final = status_key("")
AWAY: Final = "the lidar is away from its publisher"


@dataclass(frozen=True, slots=True)
class Status:
    """How a lidar is."""

    form: str  # ``scan``, ``raw`` or ``ros``
    robot: str  # name of the robot or machine
    about: About  # what the device said of itself; the responses it gave only where it was asked for
    modes: tuple[ScanMode, ...] = ()  # its scan modes, as far as they are known
    mode: ScanMode | None = None  # the one that runs, or None
    rate: float = 0.0  # scans a second at the moment
    lost: str = ""  # why the lidar is away from its publisher; empty while it is there
    sender: str = ""  # what tells this publisher from others under the same key; empty where it does not say

    def to_bytes(self, *, whole: bool) -> bytes:
        """As JSON; `whole` with everything that the device has responded, else with the stream that runs alone."""
        events = self.about.events
        if not whole:
            events = tuple(each for each in events if isinstance(each, StreamBegan))
        about = replace(self.about, events=events)
        record = {
            "form": self.form,
            "robot": self.robot,
            "about": about.as_texts(),
            "modes": [asdict(mode) for mode in self.modes],
            "mode": None if self.mode is None else asdict(self.mode),
            "rate": round(self.rate, 3) if math.isfinite(self.rate) else 0.0,
            "lost": self.lost,
            "sender": self.sender,
        }
        return json.dumps(record, separators=(",", ":")).encode()

    @classmethod
    def of(cls, data: bytes) -> Self | None:
        """What `to_bytes` wrote; None where it is nothing of the kind."""
        try:
            if len(data) > LARGEST:
                return None
            record = json.loads(data)
            texts = {str(name): str(value) for name, value in record["about"].items()}
            mode, rate = record.get("mode"), record.get("rate", 0.0)
            return cls(
                form=printable(record["form"], _MOST_LETTERS),
                robot=printable(record.get("robot", ""), _MOST_LETTERS),
                about=About.of(texts),
                modes=tuple(mode_of(each) for each in record.get("modes", ())[:_MOST_MODES]),
                mode=None if mode is None else mode_of(mode),
                rate=float(rate) if isinstance(rate, int | float) and 0 <= rate < 1e6 else 0.0,
                lost=printable(record.get("lost", ""), _MOST_LETTERS),
                sender=printable(record.get("sender", ""), _MOST_LETTERS),
            )
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            return None


async def statuses(bus: Bus, key: str) -> list[tuple[str, Status]]:
    """What the publishers under `key`, which may have wildcards, tell when they are asked; each with its key."""
    found: list[tuple[str, Status]] = []
    for reply in await bus.query(status_key(key), ASK_S):
        # Each may take milliseconds, and how many there are is for the network to say.
        await asyncio.sleep(0)
        if (status := Status.of(reply.payload)) is not None:
            found.append((reply.key.removesuffix(_SUFFIX), status))
    return found
