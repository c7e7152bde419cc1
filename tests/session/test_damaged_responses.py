"""Responses carry no check value: on a line that damages them, what they tell is believed when it comes twice."""

from functools import partial

import pytest

from lidario import ConnectFailed, Health, LidarError, ScanMode, Unsupported, open_lidar
from tests.support.loop import now, run_driven

SEEDS = 12
MODELS = ["rplidar-s2", "rplidar-a1", "rplidar-express", "ydlidar-4ros"]


def told(model: str, fault: str) -> tuple[tuple[ScanMode, ...], Health, float | None] | None:
    """What a device tells of itself; None where the line lets nothing through."""

    async def main() -> tuple[tuple[ScanMode, ...], Health, float | None] | None:
        try:
            async with open_lidar(f"sim://{model}?via=memory{fault}") as lidar:
                try:
                    frequency = await lidar.get_scan_frequency()
                except Unsupported:
                    frequency = None
                return await lidar.get_modes(), await lidar.get_health(), frequency
        except ConnectFailed:
            raise
        except LidarError:
            return None

    return run_driven(main)


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_nothing_wrong_is_believed(model: str, caplog: pytest.LogCaptureFixture) -> None:
    clean = told(model, "")
    assert clean is not None
    modes, health, frequency = clean
    answered = 0
    for seed in range(SEEDS):
        caplog.clear()
        found = told(model, f"&seed={seed}&fault=flip:1%25")
        if found is None:
            continue
        answered += 1
        assert "stopped to protect itself" not in caplog.text
        assert found[0] == modes or "did not tell" in caplog.text, seed
        assert found[1] == health, seed
        assert found[2] == frequency, seed
    assert answered > SEEDS / 2


@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a1"])
def test_to_ask_until_two_are_alike_takes_a_bounded_time(model: str) -> None:
    """Where most questions have no response, or one that is late, too."""

    async def main(seed: int) -> float:
        device = f"sim://{model}?via=memory&seed={seed}&fault=late:700ms,wrong-response:40%25,drop:1%25"
        try:
            async with open_lidar(device) as lidar:
                began = now()
                await lidar.get_modes()
                return now() - began
        except LidarError:
            return 0.0

    assert 5.0 < max(run_driven(partial(main, seed)) for seed in range(12)) < 60.0
