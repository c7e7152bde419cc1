"""One zenoh router for all tests of this folder, where each uses keys of its own; and a recording."""

from collections.abc import Iterator

import pytest

from tests.support.recorded import record
from tests.support.router import Router, client


@pytest.fixture(scope="session", autouse=True)
def router() -> Iterator[Router]:
    """A router that runs from the first test to the last one: zenoh keeps some files open once it was used."""
    made = Router()
    # A client, too, opens what zenoh keeps for the life of the process.
    client(made.address).close()  # type: ignore[no-untyped-call]
    yield made
    made.stop()


@pytest.fixture(scope="session")
def tape(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A recording: its lidar needs no time to speed up."""
    return str(record(tmp_path_factory.mktemp("tape") / "run.mcap", "sim://rplidar-s2", 12).path)
