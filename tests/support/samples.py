"""What stands for all where a test would take too long over all: a stream for each parser, a model of each kind."""

from collections.abc import Sequence
from typing import Any

import pytest

from lidario.families.registry import FAMILIES
from lidario.wire.formats import StreamFormat
from tests.support.case import Case
from tests.support.families import ABOUT

MODELS = [model for family in FAMILIES for model in family.simulated]
"""Every simulated model."""
SOME_MODELS = [model for about in ABOUT.values() for model in about.MODELS]
"""One of each kind: of motor, of format, of what a device tells of itself, with and without commands."""
ONE_A_FAMILY = [about.MODELS[0] for about in ABOUT.values()]


def is_quick(number: int) -> bool:
    """Whether the quick tests take the value with this number of a long list.

    Three of eleven: where two, three, four or seven kinds take turns, some of each.
    """
    return number % 11 in (0, 3, 7)


def long_but_some(*values: Any) -> list[Any]:
    """Values for `pytest.mark.parametrize`, of which the quick tests take some; for a fixture that has its own."""
    return [
        value
        if is_quick(number)
        else pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.long)
        for number, value in enumerate(values)
    ]


def every_model() -> pytest.MarkDecorator:
    """Marks a test that takes a `model`: one of each kind, and with ``--exhaustive`` all of them."""
    return pytest.mark.exhaustive("model", sample=SOME_MODELS, full=MODELS)


def one_a_parser(full: Sequence[Case], among: Sequence[Case] = ()) -> pytest.MarkDecorator:
    """Marks a test that takes a `case`: a stream for each parser, and with ``--exhaustive`` all of `full`.

    It is the shortest of them, or of `among`.
    """
    chosen: dict[type, Case] = {}
    for case in sorted(among or full, key=lambda case: (len(_classes(case)), len(case.raw))):
        chosen.setdefault(_classes(case)[-1], case)
    return pytest.mark.exhaustive("case", sample=list(chosen.values()), full=full)


def _classes(case: Case) -> tuple[type, ...]:
    """The class that parses the stream, and those it inherits from: the last one is common to all of its kind."""
    classes = type(case.make_format()).__mro__
    return classes[: classes.index(StreamFormat)]
