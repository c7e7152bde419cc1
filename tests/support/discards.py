"""On an undamaged line the strict simulated device has no reason to discard a request, so in no test does it.

Three reasons are no mistake of the host, and allowed everywhere. A device does not know every request, and the host
learns that by asking. A device that boots gives no sign when it is done, so the host asks what it is until it
responds, and one that has fallen silent how it is; if the host gives up meanwhile, it writes the stop requests all
the same. A device in Protection Stop
ignores STOP, and the host writes it before it can know the state.

A device that a thread serves at true pace sees each request when the machine lets that thread run: on a busy
machine a STOP late and the next request in time, as if the host had not waited. So what is discarded for its time
alone counts only where the clock is driven; there the same session code is tried at every step.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any
from weakref import WeakSet

import pytest

from lidario.sim.chassis import Chassis
from lidario.sim.device import Received, SimulatedDevice
from lidario.sim.server import Server

UNKNOWN = "unknown to this "
BOOTING = "still booting"
PROTECTED = "in protection stop"
ASKED_WHILE_BOOTING = {
    "get_info", "get_health", "stop", "forced_stop", "motor_speed_ctrl", "set_motor_pwm", "new_baudrate_confirm",
}  # fmt: skip


_served: WeakSet[Any] = WeakSet()
"""Devices that a thread serves at true pace."""


@contextmanager
def devices_made() -> Iterator[list[SimulatedDevice]]:
    """Collect every simulated device that is made in the block, whoever makes it."""
    devices: list[Any] = []
    make, serve = Chassis.__init__, Server.__init__

    def served(self: Any, device: Any, *args: Any, **kwargs: Any) -> None:
        serve(self, device, *args, **kwargs)
        with suppress(TypeError):  # tests serve stand-ins too
            _served.add(device)

    def made(self: Any, *args: Any, **kwargs: Any) -> None:
        make(self, *args, **kwargs)
        devices.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Chassis, "__init__", made)
        patch.setattr(Server, "__init__", served)
        yield devices


def all_obeyed(devices: Iterable[SimulatedDevice]) -> None:
    """Fail when one of the devices has discarded a request; tell which, why, and what came shortly before.

    A request right behind a STOP that was ignored counts as discarded: behind another STOP it would have been.
    """
    for device in devices:
        log = device.log
        for at, each in enumerate(log):
            early = (each.why or each.remark).startswith(("within ", "while "))
            fine = was_in_time(each) or _no_mistake(each) or (device in _served and early)
            assert fine, f"the device discarded:\n{_told(log[max(0, at - 4) : at + 1])}"


def was_in_time(request: Received) -> bool:
    """Whether the device obeyed a request, and would have, had the STOP before it not been ignored."""
    return request.obeyed and not request.remark.startswith("within ")


def some_discarded(devices: Iterable[SimulatedDevice]) -> bool:
    """Whether `all_obeyed` would fail."""
    return any(not was_in_time(each) and not _no_mistake(each) for device in devices for each in device.log)


def may_discard(item: pytest.Item) -> bool:
    """Whether the test, or its module, is marked ``discards``.

    Raises:
        ValueError: The marker gives no reason.
    """
    marks = list(item.iter_markers("discards"))
    for mark in marks:
        if len(mark.args) != 1 or not isinstance(mark.args[0], str) or not mark.args[0].strip():
            raise ValueError(f"{item.nodeid}: the marker discards needs a reason")
    return bool(marks)


def _no_mistake(discarded: Received) -> bool:
    booting = discarded.why.startswith(BOOTING) and discarded.name in ASKED_WHILE_BOOTING
    stopped_already = discarded.why == PROTECTED and discarded.name == "stop"
    return booting or stopped_already or discarded.why.startswith(UNKNOWN)


def _told(requests: list[Received]) -> str:
    end = requests[-1].at_ns
    return "\n".join(
        f"  {(each.at_ns - end) * 1e-6:10.2f} ms  {each.name} {each.data.hex(' ')}  {each.why or each.remark}"
        for each in requests
    )
