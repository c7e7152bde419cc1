"""Simulated devices for users: `simulate` makes one that can be given to `open_lidar`."""

from collections.abc import Iterable
from typing import SupportsIndex

import numpy as np

from lidario.basics.arguments import finite, shown, whole
from lidario.errors import ConnectFailed, InvalidValue
from lidario.families.registry import FAMILIES, family_of_simulated
from lidario.sim.device import SimulatedDevice
from lidario.sim.rooms import make_world
from lidario.sim.world import Wall, World, WorldLike, as_world, cast, measures, segments_of

_WORLDS = "A world is a name, a list of walls or an object with the method ranges_mm"
_PROBE_DEG = np.linspace(0.0, 350.0, 36)


def simulate(
    model: str | None = None,
    *,
    world: str | WorldLike | Iterable[Wall] = "room",
    spin_up: float | None = None,
    seed: SupportsIndex = 0,
    serial: str | bytes | None = None,
) -> SimulatedDevice:
    """Make a simulated device for `open_lidar`.

    ::

        room = [((2, -1), (2, 1)), ((2, 1), (-2, 1)), ((-2, 1), (-2, -1)), ((-2, -1), (2, -1))]
        async with lidario.open_lidar(lidario.simulate(world=room, spin_up=0)) as lidar:
            scan = await lidar.scan()

    It lives in memory, on the clock of the event loop, and is as strict as a real one. For faults use a source:
    ``sim://MODEL?via=memory&fault=drop:1%,reboot:5s``.

    Args:
        model: Its name as in ``sim://MODEL``; `lidario sim --list` names all. None: the first of them.
        world: What it sees: ``room``, ``corridor``, ``circle`` or ``empty``; or walls, each
            ``((x1, y1), (x2, y2))`` in metres, x forward and y to the left, the scanner at the origin; or an object
            of your own with a method ``ranges_mm(angles, times)``, see `WorldLike`. Such an object is called once
            here, with 36 angles at the time 0. Later its results are checked each time, and what it raises
            ends the session.
        spin_up: Seconds the motor needs from standstill to a stable speed; 0 for tests; None as the model does.
        seed: Decides everything random: noise, first angle, serial number.
        serial: Its serial number, as bytes or in hexadecimal digits; None: drawn from the seed.

    Returns:
        The device, switched on and not scanning. It serves one session at a time.

    Raises:
        InvalidValue: An argument cannot be right; the text says which values can. A ValueError of your own
            world becomes one, too; what else it raises passes unchanged.
    """
    name = FAMILIES[0].simulated[0] if model is None else model
    try:
        family = family_of_simulated(name)
    except ConnectFailed as error:
        raise InvalidValue(str(error)) from None
    number = whole(seed, "a seed")
    if number < 0:
        raise InvalidValue(f"a seed is a whole number from 0 on, not {shown(seed)}")
    sight = _world(world, number)
    if spin_up is not None and finite(spin_up, "spin_up") < 0:
        raise InvalidValue(f"spin_up is a number of seconds from 0 on, not {spin_up:g}")
    until_stable, own = None if spin_up is None else float(spin_up), serial_of(serial)
    try:
        return family.simulate(name, world=sight, serial=own, seed=number, spin_up=until_stable)
    except ValueError as error:
        raise InvalidValue(str(error)) from error


def _world(world: str | WorldLike | Iterable[Wall], seed: int) -> WorldLike:
    """The world that is meant; tried once, so that a mistake in it shows here and not in the middle of a stream."""
    try:
        if isinstance(world, str):
            return make_world(world, seed=seed)
        if measures(world):
            found = as_world(world)
        elif isinstance(world, Iterable):
            return World(cast(segments_of(world)))
        else:
            raise ValueError(f"{type(world).__name__} is not a world")
    except ValueError as error:
        raise InvalidValue(f"{error}. {_WORLDS}") from error
    try:
        found.ranges_mm(_PROBE_DEG.copy(), np.zeros_like(_PROBE_DEG))
    except ValueError as error:
        raise InvalidValue(str(error)) from error
    return found


def serial_of(serial: object) -> bytes | None:
    """A serial number as bytes; None stays None."""
    try:
        own = bytes.fromhex(serial) if isinstance(serial, str) else serial
        if own is None or isinstance(own, bytes | bytearray):
            return None if own is None else bytes(own)
    except ValueError:
        pass
    raise InvalidValue(f"a serial number is written in hexadecimal digits, not {shown(serial)}")
