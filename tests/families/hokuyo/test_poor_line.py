"""Hokuyo on a poor line: a scan is one packet, and one lost byte damages it."""

from __future__ import annotations

import pytest

from lidario import open_lidar
from lidario.testing import SimulatedLidar
from tests.support.devices import take
from tests.support.loop import driven


@pytest.mark.parametrize("model", ["hokuyo-urg04lx", "hokuyo-utm30lx"])
def test_many_damaged_scans_in_a_row_do_not_end_a_stream(model: str) -> None:
    """Two of three scans are damaged, or more, where each is one packet of two thousand bytes."""

    @driven
    async def main() -> None:
        device = SimulatedLidar(model, fault="drop:0.05%")
        async with open_lidar(device) as lidar:
            assert len(await take(lidar, 100)) == 100

    main()
