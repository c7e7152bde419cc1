"""Filters where scans and sectors are read: in streams, also without ``await``."""

import asyncio
from typing import Any

import numpy as np
import pytest

import lidario
from lidario import InvalidValue, Scan
from lidario.filters import RangeFilter, ShadowsFilter
from lidario.testing import Body, SimulatedLidar
from tests.support.loop import driven

NEAR = RangeFilter(lower_threshold=1.0)


def lidar() -> SimulatedLidar:
    return SimulatedLidar(bodies=[Body([(0, 0.6, 0.0)])])


async def test_each_reader_has_filters_of_its_own() -> None:
    async with lidario.open_lidar(lidar()) as session:
        async with session.scans() as bare, session.scans(filters=[NEAR, ShadowsFilter()]) as clean:
            one, two = await asyncio.gather(anext(bare), anext(clean))
        nearest, other = one.nearest(), two.nearest()
        assert nearest is not None
        assert other is not None
        assert nearest.range < 0.5
        assert other.range > 1.0
        assert not one.left_out.any()
        np.testing.assert_array_equal(two.left_out, one.filtered(NEAR, ShadowsFilter()).left_out)


async def test_sectors() -> None:
    async with lidario.open_lidar(lidar()) as session, session.sectors(90, filters=[NEAR]) as sectors:
        found = [await anext(sectors) for _ in range(4)]
    assert any(each.left_out.any() for each in found)
    assert all(each.nearest() is None or (each.ranges[each.valid] >= 1.0).all() for each in found)


@pytest.mark.long
def test_without_await() -> None:
    with lidario.open_sync(lidar()) as session:
        scan = next(session.scans(filters=[NEAR]))
        sector = next(session.sectors(45, filters=[NEAR]))
    assert scan.left_out.any()
    assert sector.left_out.any()
    assert (scan.ranges[scan.valid] >= 1.0).all()


async def test_a_filter_that_fails_is_told_to_its_reader_and_the_stream_goes_on() -> None:
    calls = 0

    def fails_once(scan: Scan) -> Scan:
        nonlocal calls
        calls += 1
        if calls == 1:
            raise ArithmeticError("no")
        return scan

    device = lidar()
    async with lidario.open_lidar(device) as session, session.scans(filters=[fails_once]) as scans:
        with pytest.raises(ArithmeticError):
            await anext(scans)
        assert (await anext(scans)).seq >= 1
    assert device.is_still


@driven
async def test_what_are_no_filters() -> None:
    async with lidario.open_lidar(lidario.simulate(spin_up=0)) as session:
        wrong: Any
        for wrong in (NEAR, [3], "x", 5, None):
            for method in (session.scans, session.sectors):
                with pytest.raises(InvalidValue, match="filter"):
                    method(filters=wrong)
