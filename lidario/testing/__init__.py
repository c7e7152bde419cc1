"""For tests of your own program: simulated lidars, made-up scans, recordings; no lidar is needed.

::

    async def test_the_robot_stops(simulated_lidar):
        simulated_lidar.show(bodies=[Body([(0.0, 2.0, 0.0), (3.0, 0.3, 0.0)])])
        robot = Robot()
        await robot.drive(simulated_lidar)
        assert robot.stopped
        assert simulated_lidar.is_still

pytest finds the fixtures by itself: `simulated_lidar`, `lidar_source` and `lidar_recording`, in the tests of
pytest-asyncio and of anyio, and without both. All names below work without pytest, too. Each is loaded when it is
first used, so that a run of pytest that uses none of them does not wait for numpy.
"""

from typing import TYPE_CHECKING

from lidario.loading import keep

if TYPE_CHECKING:
    from lidario.testing.device import SimulatedLidar
    from lidario.testing.drive import Drive, furnished
    from lidario.testing.made import make_scan, make_sector
    from lidario.testing.recorded import RecordedLidar
    from lidario.testing.surroundings import Body, room

__all__ = ["Body", "Drive", "RecordedLidar", "SimulatedLidar", "furnished", "make_scan", "make_sector", "room"]

_HOMES = {
    "testing.device": ("SimulatedLidar",),
    "testing.drive": ("Drive", "furnished"),
    "testing.made": ("make_scan", "make_sector"),
    "testing.recorded": ("RecordedLidar",),
    "testing.surroundings": ("Body", "room"),
}


def __getattr__(name: str) -> object:
    return keep(__name__, name, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
