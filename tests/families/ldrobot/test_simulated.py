"""The simulated LDROBOT lidars: what the one that hears obeys."""

import pytest

from lidario.families.ldrobot.simulated.device import make_simulated

S = 1_000_000_000
BEGIN = 1000 * S
START, STOP = bytes.fromhex("54A004000000005E"), bytes.fromhex("54A104000000004A")
SIX_HERTZ = bytes.fromhex("54A20470080000A1")


def test_the_one_with_requests_obeys_them() -> None:
    device = make_simulated("ldrobot-ld14p")
    device.receive(STOP, BEGIN)
    device.transmit(BEGIN + S)
    assert (device.scanning, device.motor_on) == (False, False)
    assert device.transmit(BEGIN + 3 * S) == b""
    assert device.wakeup(BEGIN + 3 * S) is None
    device.receive(SIX_HERTZ + START, BEGIN + 3 * S)
    assert device.scanning
    packets = device.transmit(BEGIN + 6 * S)
    assert packets.startswith(bytes.fromhex("54A204"))
    assert [each.name for each in device.log] == ["stop", "set_speed", "start"]
    assert all(each.obeyed for each in device.log)


@pytest.mark.discards("a request with a wrong check value")
def test_a_wrong_check_value_is_discarded() -> None:
    device = make_simulated("ldrobot-ld14p")
    device.receive(STOP[:-1] + b"\0", BEGIN)
    assert [(each.name, each.why) for each in device.log] == [("stop", "wrong check value")]
    assert device.scanning
