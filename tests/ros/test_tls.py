"""The certificates and the files of docs/fleets.md: who is let in, and what the access rules let pass."""

import asyncio
import re
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import lidario
from lidario.errors import ConnectFailed
from lidario.ros import Fleet, Share, list_remote_lidars
from tests.scans.test_scan import FOUR
from tests.support.pages import blocks
from tests.support.router import Router

PAGE = (Path(__file__).parents[2] / "docs" / "fleets.md").read_text(encoding="utf-8")
SIM = "sim://rplidar-s2?via=memory"
BOUND_S = 30.0


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with all that the page shows, with this machine's address; it is the current one."""
    monkeypatch.chdir(tmp_path)
    shown = {block.title: block.text for block in blocks(PAGE)}
    script = shown["certificates.sh"].replace("DNS:fleet.example", "IP:127.0.0.1")
    (tmp_path / "router.json5").write_text(shown["router.json5"])
    for name in ("r7", "control-room"):
        (tmp_path / f"{name}.json5").write_text(shown["client.json5"].replace("r7", name))
    _shell(script, tmp_path)
    # Somebody with an authority of his own, who believes in the router's.
    (tmp_path / "other").mkdir()
    _shell(script, tmp_path / "other")
    stranger = re.sub("(r7[-a-z]*.pem)", r"other/\1", shown["client.json5"])
    (tmp_path / "stranger.json5").write_text(stranger)
    return tmp_path


@pytest.fixture
def guarded(folder: Path) -> Iterator[Router]:
    router = Router("tls", (folder / "router.json5").read_text())
    yield router
    router.stop()


@pytest.mark.long
async def test_who_is_let_in_and_what_passes(guarded: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    address = guarded.address
    monkeypatch.setenv("ZENOH_CONFIG", "r7.json5")
    async with (
        lidario.open_lidar(SIM) as lidar,
        Share(lidar, "robots/r7/scan", router=address) as own,
        Share(lidar, "robots/r8/scan", router=address) as other,
        Fleet("robots/*/scan", router=address) as curious,
    ):
        assert await own.is_passed_on()
        monkeypatch.setattr("lidario.ros.broadcast.HEARD_S", 0.3)
        assert not await other.is_passed_on()
        monkeypatch.setenv("ZENOH_CONFIG", "stranger.json5")
        with pytest.raises(
            ConnectFailed, match=r"somebody listens there, but the TLS connection failed\. Does ZENOH"
        ):
            await list_remote_lidars(address)
        monkeypatch.setenv("ZENOH_CONFIG", "control-room.json5")
        async with asyncio.timeout(BOUND_S), Fleet("robots/*/scan", router=address) as fleet:
            publishing = asyncio.create_task(_publish(other, own))
            for _ in range(3):
                # The other robot's scan was sent before each of these.
                assert (await anext(fleet)).key == "robots/r7/scan"
            (found,) = await list_remote_lidars(address)
            assert (found.source, found.health) == ("zenoh:robots/r7/scan", lidar.health)
            async with lidario.open_lidar(f"zenoh:robots/r7/scan?router={address}") as remote:
                assert remote.info == lidar.info
                async with remote.scans() as scans:
                    assert len(await anext(scans)) == len(FOUR)
            publishing.cancel()
            await asyncio.wait([publishing])
        await curious.close()
        with pytest.raises(StopAsyncIteration):
            await anext(curious)


async def _publish(*shares: Share) -> None:
    seq = 0
    while True:
        seq += 1
        for share in shares:
            share.publish(replace(FOUR, seq=seq))
        await asyncio.sleep(0.02)


def _shell(script: str, folder: Path) -> None:
    subprocess.run(["sh", "-e", "-c", script], cwd=folder, check=True, capture_output=True, timeout=BOUND_S)
