"""What tests of ports share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.ports import terminal_pair


@pytest.fixture
def ends() -> Iterator[tuple[int, int, str]]:
    """Both ends of a pseudo-terminal, the controlling one first, and the path of the other."""
    with terminal_pair() as pair:
        yield pair


@pytest.fixture
def terminal(ends: tuple[int, int, str]) -> tuple[int, str]:
    """Its controlling end, and the path of the other."""
    return ends[0], ends[2]
