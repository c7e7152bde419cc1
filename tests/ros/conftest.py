"""One zenoh router for all tests of this folder; each uses keys of its own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.router import Router


@pytest.fixture(scope="session", autouse=True)
def router() -> Iterator[Router]:
    """A router that runs from the first test to the last one: zenoh keeps some files open once it was used."""
    made = Router()
    # A client, too, opens what zenoh keeps for the life of the process.
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{made.address}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    zenoh.open(config).close()  # type: ignore[no-untyped-call]
    yield made
    made.stop()
