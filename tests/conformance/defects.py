"""Simulated devices that each have one defect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

import lidario
from lidario.families.rplidar.simulated.identity import Identity
from tests.conformance.wrapped import (
    Chatters,
    Damages,
    DeafAfterIdleStop,
    DeafAfterResponse,
    DeafAfterStop,
    Skips,
    StartsOnce,
    StopsLate,
)

Turns: TypeAlias = npt.NDArray[np.float64]


def turning(device: Any, odd: Callable[[Turns], Turns], told: float = 1.0) -> Any:
    """The device, with a motor whose angle or speed is not what it ought to be."""
    turns, rpm = device.motor.turns, device.motor.rpm
    patched(device, "motor.turns", lambda times: odd(turns(times)))
    return patched(device, "motor.rpm", lambda now: rpm(now) * told)


def wobbly(turns: Turns) -> Turns:
    """Ten percent faster and slower, once in three turns."""
    wobble: Turns = turns + 0.1 * 3 / 6.2832 * np.sin(turns * 6.2832 / 3)
    return wobble


def narrow(turns: Turns) -> Turns:
    """No sample in the last 30 degrees of a turn."""
    whole = np.floor(turns)
    part: Turns = whole + (turns - whole) * 330 / 360
    return part


def s2(**changes: Any) -> Any:
    """A simulated device whose profile is changed."""
    device: Any = lidario.simulate("rplidar-s2", spin_up=0)
    device.profile = replace(device.profile, **changes)
    return device


def with_mode(**changes: Any) -> Any:
    """One whose typical mode is changed."""
    device = s2()
    modes = device.profile.modes
    device.profile = replace(device.profile, modes=(*modes[:-1], replace(modes[-1], **changes)))
    return device


def patched(device: Any, name: str, value: Any) -> Any:
    """A device, or a part of it as in ``identity.respond``, one of whose attributes is another one."""
    *path, last = name.split(".")
    part = device
    for each in path:
        part = getattr(part, each)
    setattr(part, last, value)
    return device


def changes_serial(device: Any) -> Any:
    """Its serial number is another one from the fifth question on."""
    respond, asked = device.identity.respond, [0]

    def other(request: Any, *rest: Any) -> Any:
        asked[0] += request.name == "get_info"
        if asked[0] == 5:
            device.identity = Identity(bytes(range(16)))
        return respond(request, *rest) if asked[0] < 5 else device.identity.respond(request, *rest)

    return patched(device, "identity.respond", other)


def another_after_reset(device: Any) -> Any:
    """It comes back from a restart with another serial number."""

    def other() -> None:
        device.identity = Identity(bytes(16))

    return patched(device, "identity.restart", other)


def dead_standard(device: Any) -> Any:
    """The mode of SCAN is announced, and nothing comes."""
    scan = device.HANDLERS["scan"]

    def in_vain(device: Any, request: Any) -> Any:
        why = scan(device, request)
        device.halt(request.ended)
        return why

    return patched(device, "HANDLERS", {**device.HANDLERS, "scan": in_vain})


def motor_goes_on(device: Any) -> Any:
    """Speed 0 does not switch its motor off."""
    set_speed = device.set_speed
    return patched(device, "set_speed", lambda rpm, now: set_speed(rpm, now) if rpm else None)


def slow_later(device: Any) -> Any:
    """It responds after 0.7 s, from the third time on that it is asked what it is."""
    respond, asked = device.identity.respond, [0]

    def other(request: Any, *rest: Any) -> Any:
        asked[0] += request.name == "get_info"
        device.response_delay_s = 0.0015 if asked[0] < 3 else 0.7
        return respond(request, *rest)

    return patched(device, "identity.respond", other)


def no_speed(device: Any) -> Any:
    """It can be switched on and off only."""
    set_speed = device.set_speed
    return patched(device, "set_speed", lambda rpm, now: set_speed(600 if rpm else 0, now))


def four_ros() -> Any:
    """A model that tells its speed in its packets, and has power-down protection."""
    return lidario.simulate("ydlidar-4ros", spin_up=0)


def alive_for(seconds: float) -> Any:
    """Its power-down protection waits that long for its host."""
    device = four_ros()
    obey = device.obey

    def other(command: int, now: int) -> None:
        obey(command, now)
        if command == 0x60:
            device.alive_until = now + int(seconds * 1e9)

    return patched(device, "obey", other)


SCANNING: Final = {
    "modes-start",
    "speed-is-reached",
    "pause-is-told",
    "stop-while-asking",
    "question-in-stream",
    "starts-again",
    "reset-in-stream",
    "stands-at-the-end",
}
"""Rules that need a scan."""
ASKING: Final = {
    "identity-in-time",
    "health-in-time",
    "identity-is-one",
    "questions-in-a-row",
    "request-after-stop",
    "stop-at-rest",
}
"""Rules that need a response."""

DEFECTS: Final[dict[str, tuple[Callable[[], Any], str, set[str]]]] = {
    "responds late": (
        lambda: slow_later(s2()),
        "identity-in-time",
        ASKING | {"silent-at-rest", "speed-is-reached"},
    ),
    "warns of its health": (lambda: patched(s2(), "health", (1, 7)), "health-in-time", set()),
    "changes its serial number": (lambda: changes_serial(s2()), "identity-is-one", set()),
    "deaf behind its response": (
        lambda: DeafAfterResponse(s2()),
        "questions-in-a-row",
        {"identity-is-one", "request-after-stop", "health-in-time"},
    ),
    "chatters at rest": (
        lambda: Chatters(s2()),
        "silent-at-rest",
        {"stop-ends-stream", "stop-while-asking", "stands-at-the-end"},
    ),
    "lists a mode twice": (lambda: with_mode(name="Standard"), "modes-are-listed", {"revolutions-are-full"}),
    "has a speed out of its range": (lambda: s2(speed_conf=(600, 700, 1200)), "speed-within-range", set()),
    "one mode is dead": (lambda: dead_standard(s2()), "modes-start", set()),
    "tells a wrong sample time": (lambda: with_mode(reported_us_q8=9000), "sample-time", set()),
    "mirrored": (lambda: turning(s2(), np.negative), "turns-clockwise", SCANNING),
    "damages bytes": (lambda: Damages(s2()), "packets-are-whole", set()),
    "leaves packets out": (
        lambda: Skips(s2()),
        "revolutions-follow",
        {"packets-are-whole", "revolutions-are-full"},
    ),
    "sees a part of the circle": (
        lambda: turning(s2(), narrow),
        "circle-is-whole",
        {"packets-are-whole", "speed-is-reached"},
    ),
    "sees nothing": (
        lambda: lidario.simulate("rplidar-s2", spin_up=0, world="empty"),
        "ranges-are-possible",
        set(),
    ),
    "its rotor wobbles": (lambda: turning(s2(), wobbly), "rotor-is-steady", {"revolutions-are-full"}),
    "tells a wrong speed": (lambda: turning(four_ros(), lambda turns: turns, 1.1), "reported-speed", set()),
    "takes no speed": (lambda: no_speed(s2()), "speed-is-reached", set()),
    "protection ends a stream too early": (lambda: alive_for(0.2), "protection-keeps", set()),
    "protection never stops it": (lambda: alive_for(1e6), "protection-stops", set()),
    "obeys STOP late": (lambda: StopsLate(s2()), "stop-ends-stream", set()),
    "deaf behind STOP": (lambda: DeafAfterStop(s2()), "request-after-stop", {"stop-at-rest"}),
    "deaf behind STOP at rest": (
        # Each stop ends with one at rest, for the line may have lost the first.
        lambda: DeafAfterIdleStop(s2()),
        "stop-at-rest",
        {"reset-in-stream", "stop-while-asking", "starts-again", "stands-at-the-end"},
    ),
    "starts no stream soon": (lambda: StartsOnce(s2()), "starts-again", set()),
    "boots for too long": (
        lambda: patched(s2(), "boot_s", 12.0),
        "reset-boots",
        {"reset-in-stream", "stands-at-the-end"},
    ),
    "is another one after RESET": (lambda: another_after_reset(s2()), "reset-boots", set()),
    "its motor goes on": (lambda: motor_goes_on(s2()), "stands-at-the-end", set()),
}
"""By what is wrong: how it is made, the rule that says so, and which others are not held because of it."""


def make(defect: str) -> lidario.SimulatedDevice:
    """A device with that defect."""
    made: lidario.SimulatedDevice = DEFECTS[defect][0]()
    return made
