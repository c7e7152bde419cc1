"""`lidario.simulate`: what it takes, what it refuses, and what a mistake in a user's world becomes."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import lidario
from lidario.families.registry import FAMILIES
from lidario.sim.rooms import make_world
from tests.support.loop import driven

Floats = npt.NDArray[np.float64]
BOX = [((2, -1), (2, 1)), ((2, 1), (-2, 1)), ((-2, 1), (-2, -1)), ((-2, -1), (2, -1))]
"""Four metres by two, the scanner in its middle."""


class Seen:
    """A world of one's own: what it returns, as an array of the right shape where it is a number."""

    def __init__(self, result: Any) -> None:
        self.result = result
        self.calls = 0

    def ranges_mm(self, angles: Floats, times: Floats) -> Any:
        self.calls += 1
        assert angles.shape == times.shape
        if not isinstance(self.result, float):
            return self.result
        ranges = np.full(angles.shape, self.result)
        ranges.setflags(write=False)
        return ranges


class Breaking(Seen):
    """A world that raises from its second call on."""

    def ranges_mm(self, angles: Floats, times: Floats) -> Any:
        if self.calls:
            raise ZeroDivisionError("a mistake in the user's world")
        return super().ranges_mm(angles, times)


@pytest.mark.long
@driven
async def test_a_list_of_walls_is_a_world() -> None:
    for model in (family.simulated[0] for family in FAMILIES):
        async with lidario.open_lidar(lidario.simulate(model, world=BOX, spin_up=0)) as lidar:
            scan = await lidar.scan()
        x, y = scan.xy().T
        np.testing.assert_allclose(np.maximum(np.abs(x) / 2, np.abs(y)), 1.0, atol=0.02)


def test_the_seed_decides() -> None:
    one, same, other = (lidario.simulate(seed=seed) for seed in (1, 1, np.int64(2)))
    assert one.serial == same.serial != other.serial  # type: ignore[attr-defined]
    given = lidario.simulate(serial="00112233445566778899AABBCCDDEEFF")
    assert given.serial == bytes.fromhex("00112233445566778899AABBCCDDEEFF")  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"model": "nonesuch"}, "'nonesuch'(.|\n)*rplidar-s2"),
        ({"model": ""}, "name a model"),
        ({"world": "moon"}, "room"),
        ({"world": 7}, "ranges_mm"),
        ({"world": object()}, "ranges_mm"),
        ({"world": Seen}, "the class Seen"),
        ({"world": [(1, 2)]}, "x1, y1"),
        ({"world": [((1, 2), (3, "x"))]}, "x1, y1"),
        ({"world": [((1, 2), (3, math.nan))]}, "finite"),
        ({"world": [((1, 2), (3, 1e300))]}, "finite"),
        ({"world": Seen(math.nan)}, "nan mm at 0.0 degrees"),
        ({"world": Seen(math.inf)}, "inf mm"),
        ({"world": Seen(-1.0)}, "-1.0 mm"),
        ({"world": Seen([1.0])}, r"shape \(1,\) for angles of shape"),
        ({"world": Seen(None)}, "shape"),
        ({"world": Seen("far")}, "not an array of numbers"),
        ({"spin_up": -1}, "spin_up"),
        ({"spin_up": math.nan}, "spin_up"),
        ({"spin_up": math.inf}, "spin_up"),
        ({"spin_up": "fast"}, "spin_up"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"serial": "xyz"}, "hexadecimal"),
        ({"serial": "00"}, "16 bytes"),
        ({"serial": 16}, "hexadecimal"),
        ({"model": "ydlidar-4ros", "serial": b"x" * 16}, "16 digits"),
    ],
)
def test_what_cannot_be_right_is_refused(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(lidario.InvalidValue, match=says):
        lidario.simulate(**arguments)


@pytest.mark.parametrize("model", [family.simulated[0] for family in FAMILIES])
def test_a_mistake_in_a_world_leaves_through_the_device(model: str) -> None:
    """It is not turned into silence: whoever serves the device gets the exception."""
    device = lidario.simulate(model, world=Breaking(0.0), spin_up=0)
    with pytest.raises(ZeroDivisionError, match="the user's world"):
        # Each begins to scan by its own request, or by itself, and takes the others for noise.
        device.receive(bytes.fromhex("A520" if device.baudrate == 1_000_000 else "A560"), 0)
        device.receive(b"\nMD0044072501000\n", 0)
        device.transmit(1_000_000_000)


def test_a_world_that_is_replaced_is_checked_too() -> None:
    device: Any = lidario.simulate(spin_up=0)
    device.world = Seen(math.nan)
    device.receive(b"\xa5\x20", 0)
    with pytest.raises(ValueError, match="nan mm"):
        device.transmit(1_000_000_000)
    device.world = circle = make_world("circle")
    assert device.world is circle
    with pytest.raises(ValueError, match="ranges_mm"):
        device.world = "circle"


def test_the_function_is_not_hidden_by_a_module() -> None:
    """A submodule of the same name would replace it as soon as anything imports the module."""
    import lidario.port.simulation

    assert callable(lidario.simulate)
