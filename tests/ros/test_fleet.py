"""Many lidars behind one router: one reader has the scans of all of them."""

import asyncio
from contextlib import AsyncExitStack
from dataclasses import replace

import numpy as np
import pytest

import lidario
from lidario.network.keys import Attachment
from lidario.network.messages import encode_scan
from lidario.ros import Fleet, FleetScan, Share
from lidario.scans.scan import Scan
from tests.scans.test_scan import FOUR
from tests.support.loop import until
from tests.support.network import BOUND_S, Rig, publish_in_vain
from tests.support.refused import refused
from tests.support.router import Router, client


@pytest.mark.long
async def test_many_lidars_are_one_fleet_or_have_to_be_named(router: Router) -> None:
    async with Rig(router) as rig:
        fleet = await rig.enter_async_context(Fleet("many/*/scan", router=router.address, depth=4))
        shares = []
        for robot in ("a", "b"):
            share = Share(await rig.open(), f"many/{robot}/scan", router=router.address)
            shares.append(await rig.enter_async_context(share))
        with refused("ambiguous", r"2 lidars .* name one:\nzenoh:many/a/scan\nzenoh:many/b"):
            await lidario.open_lidar(f"zenoh:many/*/scan?router={router.address}")
        # The reader does nothing meanwhile. The busier lidar pushes out no scan of the other one.
        for number in range(6):
            if number == 3:
                for _ in range(2):
                    publish_in_vain(shares[0], FOUR)
            shares[0].publish(replace(FOUR, seq=number))
        shares[1].publish(FOUR)
        # Those of the two arrive in any order.
        await until(lambda: fleet.dropped == 2)
        seen = [await anext(fleet) for _ in range(5)]
        assert [(each.scan.seq, each.lost) for each in seen if each.key == "many/a/scan"] == [
            (2, 2), (3, 2), (4, 0), (5, 0),
        ]  # fmt: skip
        assert {each.key for each in seen} == {"many/a/scan", "many/b/scan"}
        assert (fleet.lost, fleet.dropped, fleet.bad_messages) == (2, 2, 0)
        rig.enter_context(client(router.address)).put("many/b/scan", b"junk")
        await until(lambda: fleet.bad_messages)
        reading = asyncio.ensure_future(anext(fleet))
        await asyncio.sleep(0)
        await fleet.close()
        with pytest.raises(StopAsyncIteration):
            await reading


@pytest.mark.long
async def test_two_lidars_under_one_key_are_told_once(router: Router, caplog: pytest.LogCaptureFixture) -> None:
    """Not a publisher that starts anew: it does not come back as who it was."""
    one, two, anew = (bytes([number]) * 16 for number in range(3))
    async with Fleet("mixed/**", router=router.address) as fleet:
        with client(router.address) as sender:
            sent = [("mixed/b", one), ("mixed/b", anew), *(("mixed/a", each) for each in (one, two, one, two, one))]
            for number, (key, gid) in enumerate(sent):
                attachment = Attachment(number, 0, gid).to_bytes()
                sender.put(key, encode_scan(FOUR), attachment=attachment)
            seen = set[str]()
            async with asyncio.timeout(BOUND_S):
                while seen != {"mixed/a", "mixed/b"} or not caplog.messages:
                    seen.add((await anext(fleet)).key)
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("zenoh:mixed/a: two publishers send under this key")


@pytest.mark.long
async def test_a_fleet_decodes_raw_bytes(router: Router) -> None:
    """Beside whole scans, of two families; a raw message that is lost is told."""
    async with AsyncExitStack() as stack:
        fleet = await stack.enter_async_context(Fleet("bytes/*/scan", router=router.address))
        sent: dict[str, list[Scan]] = {}
        for name, family, raw in (("a", "rplidar", True), ("b", "ydlidar", True), ("c", "rplidar", False)):
            rig = await stack.enter_async_context(Rig(router))
            key = f"bytes/{name}/scan"
            share = Share(await rig.open(family), key, raw=raw, router=router.address)
            rig.run(await stack.enter_async_context(share))
            sent[key] = rig.sent
        got: dict[str, list[FleetScan]] = {key: [] for key in sent}
        async with asyncio.timeout(BOUND_S):
            while min(map(len, got.values())) < 4:
                each = await anext(fleet)
                got[each.key].append(each)
        for key, scans in got.items():
            for each in scans:
                at_ns = each.scan.wall_stamp_ns
                await until(lambda key=key, at_ns=at_ns: sent[key][-1].wall_stamp_ns > at_ns)  # type: ignore[misc]
                (before,) = [scan for scan in sent[key] if abs(scan.wall_stamp_ns - at_ns) < 50_000]
                np.testing.assert_array_equal(each.scan.device_angles, before.device_angles)
                np.testing.assert_array_equal(each.scan.device_distances, before.device_distances)
                assert each.scan.mode == before.mode
                # On a busy machine this reader may be too slow, and it is told.
                assert each.lost <= fleet.dropped
        assert (fleet.lost, fleet.bad_messages) == (0, 0)
