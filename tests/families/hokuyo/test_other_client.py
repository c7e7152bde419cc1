"""A client that is not ours reads the simulated device over TCP: hokuyolx, by another author."""

from itertools import pairwise

import numpy as np
import pytest
from hokuyolx import HokuyoLX

import lidario
from lidario.sim.serve import TcpServer
from tests.support.ports import PATIENCE_S

CORNERS = ((3.0, -2.0), (3.0, 2.0), (-2.0, 2.0), (-2.0, -2.0))
ONE_BYTE = 1
"""What it reads at once. It takes a read that ends in an empty line for one block, also where more have come."""
BOX = list(pairwise((*CORNERS, CORNERS[0])))
"""Walls without noise, so that each scan is the same."""


@pytest.mark.long
@pytest.mark.parametrize("model", ["hokuyo-ust10lx", "hokuyo-utm30lx"])
def test_hokuyolx_reads_what_the_device_measures(model: str) -> None:
    device = lidario.simulate(model, world=BOX)
    with TcpServer(device) as server:
        laser = HokuyoLX(addr=server.address, buf=ONE_BYTE, timeout=PATIENCE_S, tsync=False, convert_time=False)
        try:
            assert laser.sensor_parameters()["AFRT"] == 540
            assert "PROT" in laser.version()
            assert laser.laser_state()[0] in (0, 3)
            singles = [laser.get_dist()[1], laser.get_intens()[1][:, 0]]
            runs = [scan for scan, _, _ in laser.iter_dist(3)]
            runs += [scan[:, 0] for scan, _, _ in laser.iter_intens(3)]
            degrees = np.degrees(laser.get_angles())
        finally:
            laser.close()
    assert len(runs) == 6
    assert degrees[[0, 540, 1080]].tolist() == pytest.approx([-135, 0, 135])
    # The box, by hand: ahead 3 m, left and right 2 m.
    for scan in (*singles, *runs):
        assert scan[[540, 180, 900]].tolist() == pytest.approx([3000, 2000, 2000], abs=1)
    assert not device.scanning
