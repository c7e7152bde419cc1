"""The simulated device: letters start and stop it."""

from functools import partial

import pytest

from lidario.families.hlds.simulated import PROFILES, make_simulated
from tests.reference import hlds, samples
from tests.support.devices import Rig, call

S = 1_000_000_000
BEGIN = 1000 * S
whole = partial(samples.whole, size=hlds.PACKET_BYTES, is_packet=hlds.is_packet)


def test_the_older_one_waits_for_its_letter_also_when_it_was_off() -> None:
    device = make_simulated("hlds-lds01-2016")
    device.transmit(BEGIN)
    assert device.transmit(BEGIN + 5 * S) == b""
    assert device.wakeup(BEGIN + 5 * S) is None
    device.receive(b"b", BEGIN + 5 * S)
    assert len(whole(device.transmit(BEGIN + 8 * S))) > 400
    device.reboot(BEGIN + 8 * S)
    device.transmit(BEGIN + 8 * S)
    assert device.transmit(BEGIN + 12 * S) == b""
    assert not device.motor_on


@pytest.mark.discards("it boots")
@pytest.mark.parametrize("model", PROFILES)
def test_letters(model: str) -> None:
    device = make_simulated(model)
    device.transmit(BEGIN)
    device.receive(b"bxe", BEGIN + S)
    device.transmit(BEGIN + S)
    assert [(each.name, each.obeyed) for each in device.log] == [("start", True), ("stop", True)]
    assert not device.motor_on
    # What had begun to leave.
    assert len(device.transmit(BEGIN + 4 * S)) < 42
    device.reboot(BEGIN + 4 * S)
    device.receive(b"b", BEGIN + 4 * S + S // 10)
    assert device.log[-1].why == "still booting"


@pytest.mark.parametrize("rig", ["hlds-lds01"], indirect=True)
async def test_one_whose_check_value_nobody_knows_says_so(rig: Rig) -> None:
    rig.device.check = b"\x01\x02"
    async with rig.open() as lidar, lidar.scans() as stream:
        assert "no check value" in (await lidar.get_health()).note
        for _ in range(3):
            assert len(await anext(stream)) == 360


@pytest.mark.parametrize("ask", ["get_health", "get_info"])
@pytest.mark.parametrize("rig", ["hlds-lds01"], indirect=True)
async def test_a_start_that_is_lost_is_sent_again(rig: Rig, ask: str) -> None:
    async with rig.open() as lidar:
        await lidar.stop()
        receive, lost = rig.device.receive, list[bytes]()

        def lossy(data: bytes, now: int) -> None:
            if data == b"b" and not lost:
                lost.append(data)
            else:
                receive(data, now)

        rig.device.receive = lossy
        await call(lidar, ask)
        assert lost == [b"b"]
