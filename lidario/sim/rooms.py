"""Worlds that are there by name: a furnished room, a corridor, a circle, and one without any return.

`lidario.sim.world` says what a world is and how it is measured. The walls of the room and of the corridor are cast
once in a process, when a device first needs them.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from lidario.sim.world import DIRECTIONS, ORIGIN, Floats, Pose, Segment, Walker, World, cast, seen_from

_ROUND_SIDES = 720


def make_world(name: str = "room", *, seed: int = 0, pose: Pose = ORIGIN) -> World:
    """Build a world by name.

    ``room`` (furnished, an open door, a person who walks), ``corridor`` (long, open at one end), ``circle`` (2 m
    all round, no noise) or ``empty`` (no returns). The scanner stands in it at `pose`; `seed` is that of the range
    noise.

    Raises:
        ValueError: No world has that name, or somebody walks where the scanner stands.
    """
    try:
        build = _WORLDS[name]
    except KeyError:
        raise ValueError(f"no world is called {name[:80]!r}; there are {', '.join(sorted(_WORLDS))}") from None
    return build(seed, pose)


def _path(*points: tuple[float, float]) -> list[Segment]:
    """The walls along a line of corners."""
    return [(*a, *b) for a, b in pairwise(points)]


def _box(x: float, y: float, width: float, depth: float, turned_deg: float = 0.0) -> list[Segment]:
    """The four sides of a piece of furniture with its middle at x, y."""
    c, s = np.cos(np.radians(turned_deg)), np.sin(np.radians(turned_deg))
    corners = [(-width, -depth), (width, -depth), (width, depth), (-width, depth), (-width, -depth)]
    return _path(*((float(x + (c * u - s * v) / 2), float(y + (s * u + c * v) / 2)) for u, v in corners))


def _column(x: float, y: float, radius: float, sides: int = 12) -> list[Segment]:
    """A round column or chair leg."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    return _path(*zip((x + radius * np.cos(turn)).tolist(), (y + radius * np.sin(turn)).tolist(), strict=True))


@lru_cache(maxsize=1)
def furnished_room() -> tuple[Segment, ...]:
    """Eight metres by six, with a bay, a niche, furniture, and a door (1.1 m) through which beams escape."""
    walls = _path(
        (4.6, -1.7), (4.6, -2.4), (1.2, -2.4), (1.2, -2.8), (-0.6, -2.8), (-0.6, -2.4), (-3.4, -2.4),
        (-3.4, -0.4), (-3.1, -0.4), (-3.1, 0.5), (-3.4, 0.5), (-3.4, 3.3), (-0.4, 3.6), (1.6, 3.1),
        (4.6, 3.1), (4.6, -0.6),
    )  # fmt: skip
    door_leaf = _path((4.6, -1.7), (5.5, -2.2))
    furniture: Sequence[list[Segment]] = (
        _box(-2.2, -1.9, 1.8, 0.8),  # sofa
        _box(2.9, 2.75, 1.6, 0.45),  # shelf
        _box(-2.7, 2.5, 0.9, 0.9, 20.0),  # armchair
        _column(2.6, -1.0, 0.16),  # pillar
        *(_column(x, y, 0.03, 6) for x in (0.4, 1.5) for y in (1.3, 2.1)),  # the legs of a table
        _column(3.9, -2.0, 0.2),  # a plant
    )
    return (*walls, *door_leaf, *(side for piece in furniture for side in piece))


@lru_cache(maxsize=1)
def _corridor_walls() -> tuple[Segment, ...]:
    """Two metres wide, closed 12 m ahead, open behind, with two doorways let into the right wall."""
    right = _path(
        (-25.0, -0.9), (2.0, -0.9), (2.0, -1.2), (3.0, -1.2), (3.0, -0.9), (6.5, -0.9), (6.5, -1.2),
        (7.5, -1.2), (7.5, -0.9), (12.0, -0.9),
    )  # fmt: skip
    return (*right, (12.0, -0.9, 12.0, 1.1), (12.0, 1.1, -25.0, 1.1))


@lru_cache(maxsize=8)
def _table(walls: tuple[Segment, ...], pose: Pose) -> Floats:
    table = cast(seen_from(walls, pose))
    table.setflags(write=False)
    return table


def _room(seed: int, pose: Pose) -> World:
    walker = Walker((0.4, 0.1), (1.5, 1.0), pose=pose)
    return World(_table(furnished_room(), pose), walker=walker, noise_mm=4.0, seed=seed)


def _corridor(seed: int, pose: Pose) -> World:
    walker = Walker((5.0, 0.2), (4.0, 0.3), period_s=16.0, pose=pose)
    return World(_table(_corridor_walls(), pose), walker=walker, noise_mm=6.0, seed=seed)


def _circle(seed: int, pose: Pose) -> World:
    if pose == ORIGIN:
        return World(np.full(DIRECTIONS, 2000.0), seed=seed)
    return World(_table(tuple(_column(0.0, 0.0, 2.0, _ROUND_SIDES)), pose), seed=seed)


_WORLDS: dict[str, Callable[[int, Pose], World]] = {
    "room": _room,
    "corridor": _corridor,
    "circle": _circle,
    "empty": lambda seed, _: World(np.zeros(DIRECTIONS), seed=seed),
}
