"""What can go wrong inside a simulated device, and when.

There are two kinds of faults, and they do not mix. A *line fault* changes bytes on the way to the host
(`lidario.sim.faults`); the device knows nothing of it. A *device fault* is an event in the device's own life, at a
certain time: it restarts, freezes, stops to protect itself. The device must offer what `CanFail` says; every
simulated device that is built on `Chassis` does.

`MemoryLine` first lets the device send what has left it by the time of the event, and then calls
`DeviceFaults.strike`. So the bytes do not depend on how often the device is asked for bytes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, TypeGuard

ERROR_CODE = 0x8001
"""What health tells after the fault ``protect``; no document gives a meaning to any code."""

REPLUG_GAP_S = 1.0
"""Seconds without a cable, and so without power, in the fault ``replug``."""

_SECOND = 1_000_000_000


class CanFail(Protocol):
    """A simulated device in which device faults can happen; all times are monotonic nanoseconds."""

    wrong_responses: float
    """Share of the responses in whose place the device repeats the response before."""

    def reboot(self, now: int, *, off_s: float = 0.0) -> None:
        """Be without power for `off_s` seconds, then boot."""
        ...

    def freeze(self, now: int) -> None:
        """Neither send nor obey anything until the next `reboot`."""
        ...

    def protection_stop(self, error_code: int) -> None:
        """Stop because of an error, which health reports."""
        ...


def can_fail(device: object) -> TypeGuard[CanFail]:
    """Whether device faults can happen in it."""
    return all(hasattr(device, each) for each in ("wrong_responses", "reboot", "freeze", "protection_stop"))


@dataclass(slots=True)
class DeviceFaults:
    """Faults of one device, and which of them have happened; a device needs one of its own.

    `lidario.sim.faults.FAULTS` says what each of them does. Seconds count from the first byte on the line; None is
    never. Of ``replug``, only the loss of power is a fault of the device.

    Raises:
        ValueError: The share is not between 0 and 1.
    """

    reboot_s: float | None = None
    freeze_s: float | None = None
    protect_s: float | None = None
    replug_s: float | None = None
    wrong_response: float = 0.0
    _ahead: list[tuple[int, str]] = field(init=False, compare=False, default_factory=list, repr=False)

    def __post_init__(self) -> None:
        if not 0.0 <= self.wrong_response <= 1.0:
            raise ValueError("wrong-response is a share from 0 to 100 %")

    @property
    def next_at(self) -> int | None:
        """When the next event is due; None with none ahead."""
        return self._ahead[0][0] if self._ahead else None

    def check(self, device: object) -> None:
        """Prepare a device; does nothing where no device fault is wanted.

        Raises:
            ValueError: The device offers no such faults.
        """
        wanted = (self.reboot_s, self.freeze_s, self.protect_s)
        if can_fail(device):
            if self.wrong_response:
                device.wrong_responses = self.wrong_response
        elif self.wrong_response or any(each is not None for each in wanted):
            raise ValueError(f"a {type(device).__name__} offers no faults of its own, only faults of the line")

    def begin(self, now: int) -> None:
        """Begin to count the time; called once, at the first byte on the line."""
        wanted = {name: getattr(self, f"{name}_s") for name in ("protect", "reboot", "replug", "freeze")}
        found = [(now + round(each * _SECOND), name) for name, each in wanted.items() if each is not None]
        self._ahead = sorted(found, key=lambda event: event[0])

    def strike(self, device: object) -> None:
        """Let the next event happen; the device must have sent what left it before `next_at`."""
        at, name = self._ahead.pop(0)
        if not can_fail(device):
            return  # `check` has let pass a replug, which such a device survives as it is
        if name == "reboot":
            device.reboot(at)
        elif name == "replug":
            device.reboot(at, off_s=REPLUG_GAP_S)
        elif name == "freeze":
            device.freeze(at)
        else:
            device.protection_stop(ERROR_CODE)
