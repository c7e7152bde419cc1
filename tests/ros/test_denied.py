"""A robot whose messages the router's access rules deny is told: zenoh itself tells it nothing."""

import asyncio
import signal

import pytest

from lidario.network.senders import what_is_heard
from lidario.ros import Publisher, Share
from tests.support.children import BOUND, child, line_of
from tests.support.network import Rig
from tests.support.router import Router

SOON = """
from lidario.ros import broadcast
from lidario.__main__ import main
broadcast.HEARD_S = %s
main()
"""
"""The command, which waits for its own scans for so many seconds, not for five."""
RULES = """{ access_control: {
  enabled: true, default_permission: "allow",
  rules: [{ id: "r8", permission: "deny", flows: ["ingress"], messages: ["put"], key_exprs: ["robots/r8/**"] }],
  subjects: [{ id: "all" }], policies: [{ rules: ["r8"], subjects: ["all"] }],
} }"""


@pytest.mark.long
async def test_what_is_passed_on_and_what_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    router = Router(config=RULES)
    # What is waited for in vain comes often.
    monkeypatch.setattr("lidario.ros.broadcast.STATUS_S", 0.05)
    async with Rig(router) as rig:
        rig.callback(router.stop)
        lidar = await rig.open()
        allowed, denied, topic = (
            Share(lidar, "robots/r7/scan", router=router.address),
            Share(lidar, "robots/r8/scan", router=router.address),
            Publisher(lidar, domain=51, router=router.address),
        )
        assert not await allowed.is_passed_on()
        for each in (allowed, denied, topic):
            await rig.enter_async_context(each)
        # Nothing is scanned yet, and the rules are about scans alone.
        with monkeypatch.context() as patch:
            patch.setattr("lidario.ros.broadcast.HEARD_S", 1.5)
            assert await denied.is_passed_on()
        for each in (allowed, denied, topic):
            rig.run(each)
        assert await allowed.is_passed_on()
        assert await topic.is_passed_on()
        monkeypatch.setattr("lidario.ros.broadcast.HEARD_S", 0.3)
        assert not await denied.is_passed_on()
        # Cancelling leaves nothing.
        asking = asyncio.create_task(denied.is_passed_on())
        await asyncio.sleep(0.01)
        asking.cancel()
        await asyncio.wait([asking])
        assert asking.cancelled()


@pytest.mark.long
async def test_another_publisher_under_the_same_key_is_not_taken_for_this_one(router: Router) -> None:
    async with Rig(router) as rig:
        lidar = await rig.open()
        share = await rig.share("denied/same", lidar=lidar)
        own = bytes.fromhex(share.status().sender)
        assert await what_is_heard(router.address, [f"{share.key}/@lidario/status"], own, BOUND)
        assert not await what_is_heard(router.address, [f"{share.key}/@lidario/status"], bytes(16), 0.3)


@pytest.mark.long
def test_the_command_says_that_nothing_is_passed_on(tape: str) -> None:
    router = Router(config=RULES)
    common = ("publish", f"{tape}?loop=1", "--router", router.address, "--zenoh")
    try:
        with (
            child(SOON % BOUND, *common, "robots/r7/scan") as allowed,
            child(SOON % 2.0, *common, "robots/r8/scan") as denied,
        ):
            assert line_of(denied.stderr).startswith("publishing ")
            told = line_of(denied.stderr)
            assert told.startswith(
                "the router passes nothing on that is published under robots/r8/scan: do its access"
            )
            for process in (allowed, denied):
                process.send_signal(signal.SIGINT)
                assert process.wait(BOUND) == 0
            assert allowed.stderr is not None
            assert "passes nothing on" not in allowed.stderr.read()
    finally:
        router.stop()
