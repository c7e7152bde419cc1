"""A lidar of another machine is what its publisher has told, and in the mode that its publisher has chosen."""

import asyncio
from dataclasses import replace

import pytest

import lidario
from lidario.errors import Unsupported
from lidario.network.bus import Sample
from lidario.network.port import RemotePort
from lidario.recording.chronicle import StreamBegan
from tests.support.loop import until
from tests.support.network import BOUND_S, Rig
from tests.support.router import Router

pytestmark = pytest.mark.long


@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a1", "ydlidar-x4"])
async def test_who_reads_raw_bytes_is_told_what_the_publisher_is(router: Router, model: str) -> None:
    async def told(lidar: lidario.Lidar) -> list[object]:
        found: list[object] = []
        for ask in (lidar.get_modes, lidar.get_sample_rate, lidar.get_scan_frequency_range, lidar.get_health):
            try:
                found.append(await ask())
            except Unsupported as error:
                found.append(str(error))
        return found

    async with Rig(router) as rig:
        lidar = await rig.open(lidario.simulate(model, spin_up=0))
        live = await told(lidar)
        share = await rig.share(f"told/{model}", raw=True, lidar=lidar)
        rig.run(share)
        await until(lambda: rig.sent)
        assert await told(await rig.remote(share.key)) == live


@pytest.mark.parametrize("form", ["raw", "scan"])
@pytest.mark.parametrize("comes", ["at once", "later", "before its lidar scans"])
async def test_a_reader_follows_its_publisher_into_another_mode(
    router: Router, form: str, comes: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within the publisher's session, and when its program comes back with another one.

    Where only scans are sent, a reader may be back before the lidar scans again, and learns the mode later.
    """
    monkeypatch.setattr("lidario.network.port.GONE_S", 0.05)
    key = f"modes/{form}/{comes.replace(' ', '_')}"
    async with Rig(router) as rig:
        lidar = await rig.open()
        share = await rig.share(key, raw=form == "raw", lidar=lidar)
        running = rig.work(share.run("Standard"))
        await until(lambda: share.scans)
        remote, scans = await rig.read(key, reconnect=True)
        async with asyncio.timeout(BOUND_S):
            assert (await anext(scans)).mode == "Standard"
            running.cancel()
            if comes != "at once":
                await share.close()
                await until(lambda: not remote.is_connected)
                share = await rig.share(key, raw=form == "raw", lidar=lidar)
            if comes == "before its lidar scans" and form == "scan":
                await until(lambda: remote.is_connected)
            rig.work(share.run("DenseBoost"))
            while (await anext(scans)).mode != "DenseBoost":
                pass
        await until(lambda: remote.mode is not None and remote.mode.name == "DenseBoost")
        assert [mode.name for mode in await remote.get_modes() if mode.typical] == ["DenseBoost"]
        assert (await anext(scans)).mode == "DenseBoost"


@pytest.mark.parametrize("mode", ["Standard", "DenseBoost"])
async def test_who_wakes_a_lidar_that_rests_learns_its_mode(router: Router, mode: str) -> None:
    """Also the one whose number is 0."""
    async with Rig(router) as rig:
        share = await rig.share(f"modes/woken/{mode}")
        assert share.lidar.mode is None
        remote, scans = await rig.read(share.key)
        first = asyncio.ensure_future(anext(scans))
        await until(lambda: remote.mode is not None and remote.mode.name == "LaserScan")
        rig.work(share.run(mode))
        async with asyncio.timeout(BOUND_S):
            assert (await first).mode == mode
        await until(lambda: remote.mode is not None and remote.mode.name == mode)
        async with asyncio.timeout(BOUND_S):
            assert (await anext(scans)).mode == mode
        assert [each.name for each in await remote.get_modes() if each.typical] == [mode]


@pytest.mark.parametrize("form", ["raw", "scan"])
async def test_a_mode_that_is_told_while_the_stream_is_being_started_is_not_missed(
    router: Router, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Behind the opening of a stream, and before its first bytes are taken."""
    announce, told = RemotePort.announce, list[bytes]()

    def announce_and_tell(port: RemotePort) -> None:
        announce(port)
        if told:
            port.learn(Sample("", told.pop(), b""))

    monkeypatch.setattr(RemotePort, "announce", announce_and_tell)
    async with Rig(router) as rig:
        share = await rig.share(f"modes/amid/{form}", raw=form == "raw")
        rig.run(share)
        await until(lambda: share.scans)
        remote, scans = await rig.read(share.key)
        # From a publisher that does not say who it is; the status of the real one follows within a second.
        monkeypatch.setattr("lidario.network.port.OneSender.is_other", lambda self, gid: False)
        status = share.status()
        assert status.mode is not None
        old = next(mode for mode in await share.lidar.get_modes() if mode.name == "Standard")
        events = tuple(replace(each, mode=old) for each in status.about.events if isinstance(each, StreamBegan))
        status = replace(status, mode=old, about=replace(status.about, events=events))
        told.append(status.to_bytes(whole=False))
        first = asyncio.ensure_future(anext(scans))
        names = set[str]()
        async with asyncio.timeout(BOUND_S):
            while names != {"Standard", "DenseBoost"}:
                await asyncio.sleep(0)
                if remote.mode is not None:
                    names |= {remote.mode.name}
            assert (await first).mode == "DenseBoost"
        await until(lambda: remote.mode is not None and remote.mode.name == "DenseBoost")


async def test_only_its_publisher_resets_a_lidar(router: Router, caplog: pytest.LogCaptureFixture) -> None:
    """A reader is told how it is, and does not pretend to cure it."""
    async with Rig(router) as rig:
        device = lidario.simulate("rplidar-s2", spin_up=0)
        share = await rig.share("failed/scan", lidar=await rig.open(device))
        with pytest.raises(lidario.DeviceFault):
            async for _ in share.lidar.scans():
                device.protection_stop(0x8001)  # type: ignore[attr-defined]
        caplog.clear()
        remote = await rig.remote(share.key)
        assert remote.health == share.lidar.health
        assert not remote.health.ok
        with pytest.raises(Unsupported, match="another machine's lidar cannot be reset from here"):
            await remote.reset()
        with pytest.raises(Unsupported, match="network address of another machine's lidar"):
            await remote.set_network_address(lidario.NetworkAddress("192.168.0.2", "255.255.255.0", "192.168.0.1"))
        assert "is reset" not in caplog.text
