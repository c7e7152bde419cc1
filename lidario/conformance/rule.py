"""What a rule is, and what comes of trying it: plain records."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from lidario.conformance.bench import Bench


class Broken(Exception):
    """A rule is not kept; the text says by how much."""


class NotTried(Exception):
    """A rule cannot be tried on this device; the text says why."""


class Origin(Enum):
    """Who says that a rule holds."""

    MANUAL = "manual"
    PROMISE = "promise"


class Outcome(Enum):
    """What came of trying a rule."""

    HELD = "held"
    BROKEN = "not held"
    NOT_TRIED = "not tried"


class Need(Enum):
    """What a rule needs of a device; the value says what is missing where it cannot be tried."""

    HEALTH = "it protects itself, so its motor is not started"
    ANSWERS = "it only talks: it answers no question"
    STOPS = "it cannot be stopped from here"
    RESETS = "it cannot be restarted from here"
    SPEED = "its speed cannot be set from here"


@dataclass(frozen=True, slots=True)
class Rule:
    """Something that must hold of every device that can do what it needs.

    Attributes:
        name: Short name, as in a test's name.
        sentence: What must hold, in one sentence.
        origin: Whether a manual says so, or lidario promises it.
        known_from: Which part of the manual, or which page of ours.
        check: Tries it; returns what was measured. Raises `Broken` or `NotTried`.
        needs: What the device must be able to do.
        limit_s: Longest time that trying it may take, seconds of the event loop's clock.
    """

    name: str
    sentence: str
    origin: Origin
    known_from: str
    check: Callable[["Bench"], Awaitable[str]]
    needs: tuple[Need, ...] = ()
    limit_s: float = 20.0


class Figure(NamedTuple):
    """Something that was measured when a rule was tried.

    Attributes:
        name: What.
        value: How much.
        unit: Of what: ``s``, ``ms``, ``us``, ``Hz``, or empty of a number.
    """

    name: str
    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.value:.3g} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came of trying one rule on one device.

    Attributes:
        rule: The rule.
        outcome: Whether it held.
        text: What was measured; by how much it was not held; or why it was not tried.
        seconds: How long that took, seconds of the event loop's clock.
        figures: What was measured, for a table.
    """

    rule: Rule
    outcome: Outcome
    text: str
    seconds: float
    figures: tuple[Figure, ...] = ()

    def __str__(self) -> str:
        return f"{self.rule.name}: {self.outcome.value}: {self.text}"


def known(
    origin: Origin, known_from: str, *needs: Need, limit_s: float = 20.0
) -> Callable[[Callable[["Bench"], Awaitable[str]]], Rule]:
    """Decorate a check to make a `Rule` of it: what must hold is its docstring, and the name has hyphens."""

    def made(check: Callable[["Bench"], Awaitable[str]]) -> Rule:
        name = check.__name__.replace("_", "-")
        # Python without docstrings (-OO) has only the name.
        return Rule(name, check.__doc__ or name, origin, known_from, check, needs, limit_s)

    return made
