"""The faults that users can ask of a simulated device, as they type them.

A list of faults is written like ``drop:1%,flip:0.1%,unplug:5s``. A share is per byte, or per response. Durations of
``silent``, ``unplug``, ``replug`` and of all faults of the device count from the first byte on the line, either
way.
"""

import re
from typing import Literal, NamedTuple

from lidario.sim.trouble import Faults

__all__ = ["FAULTS", "Fault", "Faults", "parse_faults"]


class Fault(NamedTuple):
    """One word of the list: how it is written, what its value is, and what it does."""

    example: str
    takes: Literal["nothing", "a share", "a duration", "a number of bytes"]
    what: str


FAULTS = {
    fault.example.partition(":")[0]: fault
    for fault in (
        Fault("drop:1%", "a share", "this share of the bytes is lost"),
        Fault("flip:0.1%", "a share", "one bit is inverted in this share of the bytes"),
        Fault("insert:0.1%", "a share", "a random byte is inserted before this share of the bytes"),
        Fault("burst:0.01%", "a share", "64 bytes become random; the share is that of the first bytes"),
        Fault("duplicate:0.01%", "a share", "64 bytes come a second time; the share is as for burst"),
        Fault(
            "babble:1000",
            "a number of bytes",
            "so many random bytes a second are added, also while the device is silent",
        ),
        Fault("garbage", "nothing", "every byte is random, as at a wrong baud rate"),
        Fault("late:300ms", "a duration", "every byte arrives so much later"),
        Fault(
            "stall:200ms", "a duration", "once a second the bytes are held back so long; then they come all at once"
        ),
        Fault("silent:5s", "a duration", "from then on nothing arrives, though the port stays open"),
        Fault("unplug:5s", "a duration", "from then on the port is dead"),
        Fault(
            "replug:5s", "a duration", "the port dies; 1 s later it is back with another name, and the device boots"
        ),
        Fault("reboot:5s", "a duration", "the device restarts by itself, once"),
        Fault("freeze:5s", "a duration", "the device sends nothing and obeys nothing until it loses its power"),
        Fault("protect:5s", "a duration", "the device stops to protect itself, and health reports an error"),
        Fault(
            "wrong-response:20%",
            "a share",
            "instead of this share of the responses the device repeats the one before",
        ),
    )
}
"""Every fault by its name."""

_UNITS: dict[str, dict[str, float]] = {
    "a share": {"%": 0.01, "": 1.0},
    "a duration": {"ms": 1e-3, "s": 1.0, "min": 60.0, "": 1.0},
    "a number of bytes": {"": 1.0},
}


def parse_faults(text: str, *, seed: int = 0) -> Faults:
    """Read a list of faults such as ``"drop:1%,unplug:5s"``; an empty one means none.

    Raises:
        ValueError: The text makes no sense; says why, and which faults there are.
    """
    found: dict[str, float | bool] = {}
    for word in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = word.partition(":")
        if name not in FAULTS:
            raise ValueError(f"no fault is called {_begin(name)}; there are {', '.join(FAULTS)}")
        field = name.replace("-", "_") + ("_s" if FAULTS[name].takes == "a duration" else "")
        if field in found:
            raise ValueError(f"the fault {_begin(name)} is given twice")
        found[field] = _value(word, name, value)
    try:
        return Faults(seed=seed, **found)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f"{_begin(text)}: {error}") from None


def _value(word: str, name: str, text: str) -> float | bool:
    """The value behind the colon; True for a fault that takes none."""
    fault = FAULTS[name]
    if fault.takes == "nothing" and not text:
        return True
    units = _UNITS.get(fault.takes, {})
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)([a-z%]*)", text.strip())
    if match is None or match[2] not in units:
        raise ValueError(
            f"{_begin(word)} cannot be read: {name} takes {fault.takes}, as in {fault.example}; "
            f"the faults are {', '.join(FAULTS)}"
        )
    return float(match[1]) * units[match[2]]


def _begin(text: str) -> str:
    """A user's word in quotes, for an error text: its first 80 characters."""
    return repr(text[:80])
