"""How the tests make a simulated device of a family."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class Maker(NamedTuple):
    """What a family says of the device that stands for it.

    Attributes:
        make: Makes a simulated device by its name.
        model: The name of the one that is used where nothing else is said.
        turn_s: How long one of its revolutions takes.
        obeys: Whether it obeys requests, and so is asked, stopped and reset in most tests of sessions.
        tuned: Whether its scan frequency can be set, and it hears right behind a stop request: most of these tests
            rest on that. Others run with each that obeys.
    """

    make: Callable[..., Any]
    model: str
    turn_s: float
    obeys: bool
    tuned: bool = True
