"""A lidar, a port or a router that cannot be opened: what is said of it, and the reason that programs ask for."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from lidario.errors import ConnectFailed, ConnectReason


@contextmanager
def refused(reason: ConnectReason, match: str | None = None) -> Iterator[pytest.ExceptionInfo[ConnectFailed]]:
    """Opening fails in the block, for that reason and with these words."""
    with pytest.raises(ConnectFailed, match=match) as caught:
        yield caught
    assert caught.value.reason == reason
