"""Several searches for lidars at the same time, and a lidar that is not ready when another one is."""

import asyncio
import errno
import socket
from collections.abc import Iterator

import pytest

from lidario import ConnectFailed, Lidar, list_lidars, open_lidar
from lidario.session.finding import discovery
from tests.support.devices import hears_only, make_rig
from tests.support.loop import now
from tests.support.speeds import plugged_in
from tests.support.times import cancelled, takes

MODELS = ("rplidar-s2", "rplidar-a1", "ydlidar-4ros")


@pytest.fixture
def another_search() -> Iterator[socket.socket]:
    """A search of another program, which goes on until it is closed."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as search:
        search.bind(discovery.NAME)
        yield search


async def test_each_of_several_is_found_by_its_number_at_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each search asks at all ports, which others cannot open meanwhile."""
    plugged_in(monkeypatch, **{model: make_rig(model).device for model in MODELS})
    serials = [each.info.serial for each in await list_lidars() if each.info is not None]
    lidars: list[Lidar] = await asyncio.gather(*(open_lidar(f"id:{serial}") for serial in serials))
    assert [lidar.info.serial for lidar in lidars] == serials
    assert len(set(serials)) == len(MODELS)
    for lidar in lidars:
        await lidar.close()


async def test_a_port_that_a_search_asks_just_now_is_opened_behind_it(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged_in(monkeypatch, only=make_rig("rplidar-s2").device)
    searching = asyncio.ensure_future(list_lidars())
    await asyncio.sleep(0.05)
    async with open_lidar("serial://only?baud=1000000") as lidar:
        await lidar.scan()
        # In use, as opposed to asked.
        with pytest.raises(ConnectFailed, match="busy"):
            await open_lidar("serial://only")
    assert [each.info is not None for each in await searching] == [True]


async def test_another_search_is_waited_for(monkeypatch: pytest.MonkeyPatch, another_search: socket.socket) -> None:
    written = plugged_in(monkeypatch, only=make_rig("rplidar-s2").device)
    search = asyncio.ensure_future(list_lidars())
    await asyncio.sleep(5.0)
    assert not written
    another_search.close()
    (found,) = await asyncio.wait_for(search, 1.0)
    assert found.info is not None
    # Others may begin.
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as third:
        third.bind(discovery.NAME)


@pytest.mark.usefixtures("another_search")
async def test_a_search_that_hangs_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged_in(monkeypatch, only=make_rig("rplidar-s2").device)
    with takes(25.0):
        lidar = await open_lidar("auto")
    async with lidar:
        await lidar.scan()


async def test_no_search_is_kept_from_beginning_by_one_that_was_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged_in(monkeypatch, only=make_rig("rplidar-s2").device)
    for seconds in (0.0, 0.01, 0.1, 0.25):
        await cancelled(open_lidar("auto").__aenter__(), seconds)
        with takes(5.0):
            await list_lidars()


@pytest.mark.parametrize(("text", "family"), [("id:{serial}", None), ("auto", "ydlidar")])
async def test_one_that_still_boots_is_waited_for_where_another_responds(
    text: str, family: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, wanted = make_rig("rplidar-s2"), make_rig("ydlidar-4ros")
    plugged_in(monkeypatch, first=first.device, wanted=wanted.device)
    async with wanted.open() as lidar:
        serial = lidar.info.serial
    booted = now() + 3.0
    hears_only(wanted, lambda _: now() >= booted)
    async with open_lidar(text.format(serial=serial), family=family) as lidar:
        assert lidar.info.serial == serial


@pytest.mark.parametrize("fails", ["socket", "bind"])
async def test_where_a_sandbox_forbids_it_nobody_is_waited_for(fails: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Forbidden(socket.socket):
        def __init__(self, *_: object) -> None:
            if fails == "socket":
                raise PermissionError(errno.EPERM, "forbidden")
            super().__init__(socket.AF_UNIX, socket.SOCK_DGRAM)

        def bind(self, _: object) -> None:
            raise PermissionError(errno.EPERM, "forbidden")

    plugged_in(monkeypatch, only=make_rig("rplidar-s2").device)
    monkeypatch.setattr("lidario.session.finding.discovery.socket.socket", Forbidden)
    with takes(1.0):
        (found,) = await list_lidars()
    assert found.info is not None
