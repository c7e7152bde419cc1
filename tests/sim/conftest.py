"""What the tests of the servers of simulated devices share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.parrot import served


@pytest.fixture
def no_thread_is_left() -> Iterator[None]:
    before = served()
    yield
    assert served() == before
