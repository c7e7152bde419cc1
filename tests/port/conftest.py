"""What tests of ports share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.ports import terminal_pair


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    with terminal_pair() as (master, _, path):
        yield master, path
