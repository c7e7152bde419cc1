"""The plugin that pytest loads by itself where lidario is installed: three fixtures, two markers, one option.

It is loaded in every run of pytest, also in those that never use it. So nothing of lidario is imported before a
fixture is used, and no other plugin is needed.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from lidario.testing import RecordedLidar, SimulatedLidar

OPTION = "--lidar-source"  # also ``--lidario-device``: what conformance is tried on is a device


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that gives tests another lidar than the simulated one."""
    parser.getgroup("lidario").addoption(
        OPTION,
        "--lidario-device",
        metavar="SOURCE",
        help="what the fixture lidar_source is, and what lidario.testing.conformance tries: /dev/ttyUSB0, ...; a "
        "simulated lidar by default",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Make the markers known."""
    config.addinivalue_line(
        "markers",
        "simulated_lidar(model, walls=, bodies=, fault=, ...): what the fixture simulated_lidar is made with",
    )
    config.addinivalue_line("markers", "lidar_recording(path): the file of the fixture lidar_recording")


@pytest.fixture
def simulated_lidar(request: pytest.FixtureRequest) -> Iterator["SimulatedLidar"]:
    """A simulated lidar in a room of 4 m by 4 m, on a fast clock; give it to `lidario.open_lidar`.

    The marker ``simulated_lidar`` has the arguments of `lidario.testing.SimulatedLidar`::

        @pytest.mark.simulated_lidar(walls=room(6, 4), fault="drop:1%")
        async def test_the_map_is_right(simulated_lidar): ...
    """
    from lidario.testing.device import SimulatedLidar

    mark = request.node.get_closest_marker("simulated_lidar")
    lidar = SimulatedLidar(*mark.args, **mark.kwargs) if mark else SimulatedLidar()
    yield lidar
    lidar.close()


@pytest.fixture
def lidar_source(request: pytest.FixtureRequest) -> "SimulatedLidar | str":
    """What a test opens: the simulated lidar, or what ``pytest --lidar-source SOURCE`` names.

    So the same test runs on every machine with the simulated lidar, and on the robot with the real one::

        async def test_it_sees_the_wall(lidar_source):
            async with lidario.open_lidar(lidar_source) as lidar:
                assert (await lidar.scan()).nearest() is not None
    """
    given: str | None = request.config.getoption(OPTION)
    if given is not None:
        return given
    made: SimulatedLidar = request.getfixturevalue("simulated_lidar")
    return made


@pytest.fixture
def lidar_recording(request: pytest.FixtureRequest) -> "RecordedLidar":
    """The recording that the marker ``lidar_recording`` names; its path begins at the folder of the test's file.

    ::

        @pytest.mark.lidar_recording("corridor.mcap")
        def test_the_corridor_is_free(lidar_recording):
            assert all(is_free(scan) for scan in lidar_recording.scans)
    """
    from lidario.testing.recorded import RecordedLidar

    mark = request.node.get_closest_marker("lidar_recording")
    if mark is None or len(mark.args) != 1 or mark.kwargs:
        raise pytest.UsageError(
            'the fixture lidar_recording needs to know the file: @pytest.mark.lidar_recording("run.mcap")'
        )
    return RecordedLidar(request.path.parent / Path(mark.args[0]))
