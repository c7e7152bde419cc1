"""The plugin in a user's own run of pytest: with pytest-asyncio, with anyio, with neither; and what it costs."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]
INSTALLED = any(each.value == "lidario.testing.plugin" for each in entry_points(group="pytest11"))
"""An environment that was made before the plugin had an entry point is told to load it."""
LOAD = () if INSTALLED else ("-p", "lidario.testing.plugin")
STRICT = "[pytest]\nfilterwarnings = error\naddopts = --strict-markers\n"
OF_ASYNCIO = "asyncio_default_fixture_loop_scope = function\n"

ROBOT = """
import lidario


class Robot:
    stopped = False

    async def drive(self, source):
        async with lidario.open_lidar(source) as lidar, lidar.scans() as scans:
            async for scan in scans:
                ahead = scan.nearest(between=(-0.3, 0.3))
                if ahead and ahead.range < 0.6:
                    self.stopped = True
                    return ahead.range
"""
TESTS = """
import pytest
from lidario.testing import Body
from robot import Robot

COMES = [Body([(0.0, 1.9, 0.0), (2.0, 0.5, 0.0)])]


{mark}
async def test_it_stops_for_a_person(simulated_lidar):
    simulated_lidar.show(bodies=COMES)
    robot = Robot()
    assert 0.4 < await robot.drive(simulated_lidar) < 0.6
    assert robot.stopped
    assert simulated_lidar.is_still


{mark}
@pytest.mark.simulated_lidar(bodies=COMES, fault="drop:0.1%,flip:0.1%")
async def test_it_stops_on_a_bad_line(lidar_source):
    assert await Robot().drive(lidar_source) < 0.6
"""


def run(pytester: pytest.Pytester, *options: str) -> pytest.RunResult:
    return pytester.runpytest_inprocess(*LOAD, "-p", "no:cacheprovider", "-p", "no:cov", *options)


@pytest.fixture
def robot(pytester: pytest.Pytester) -> pytest.Pytester:
    """A folder with a user's program."""
    pytester.makefile(".ini", pytest=STRICT)
    pytester.makepyfile(robot=ROBOT)
    pytester.syspathinsert()
    return pytester


@pytest.mark.parametrize("plugin", ["asyncio", "anyio"])
def test_the_tests_of_a_robot_developer(robot: pytest.Pytester, plugin: str) -> None:
    robot.makefile(".ini", pytest=STRICT + (OF_ASYNCIO if plugin == "asyncio" else ""))
    backend = '\n\n@pytest.fixture\ndef anyio_backend():\n    return "asyncio"\n' if plugin == "anyio" else ""
    robot.makepyfile(test_robot=TESTS.format(mark=f"@pytest.mark.{plugin}") + backend)
    result = run(robot, "-p", "no:anyio" if plugin == "asyncio" else "no:asyncio")
    result.assert_outcomes(passed=2)


def test_no_other_plugin_is_needed(robot: pytest.Pytester) -> None:
    robot.makepyfile(
        test_sync="""
        import lidario
        import pytest
        from lidario.testing import make_scan

        def test_one_scan():
            assert make_scan([0.0], [0.5]).nearest().range == 0.5

        @pytest.mark.simulated_lidar(pace=100)
        def test_without_await(simulated_lidar):
            with lidario.open_sync(simulated_lidar) as lidar:
                assert lidar.scan().nearest().range == pytest.approx(2.0, abs=0.01)
        """
    )
    result = run(robot, "-p", "no:asyncio", "-p", "no:anyio")
    result.assert_outcomes(passed=2)


def test_the_same_tests_with_another_lidar(robot: pytest.Pytester) -> None:
    robot.makepyfile(
        test_source="""
        import pytest

        def test_what_it_opens(lidar_source):
            assert lidar_source == "/dev/ttyUSB7"
        """
    )
    run(robot, "-p", "no:asyncio", "--lidar-source", "/dev/ttyUSB7").assert_outcomes(passed=1)
    run(robot, "-p", "no:asyncio").assert_outcomes(failed=1)


def test_a_recording_beside_the_tests(robot: pytest.Pytester) -> None:
    robot.makefile(".ini", pytest=STRICT + OF_ASYNCIO)
    folder = robot.mkdir("tests")
    golden = (ROOT / "tests" / "data" / "ydlidar_4ros_room7.npz").read_bytes()
    (folder / "stream.npz").write_bytes(golden)
    (folder / "conftest.py").write_text(
        "import numpy as np\nfrom pathlib import Path\n\n"
        "HERE = Path(__file__).parent\n"
        "(HERE / 'run.bin').write_bytes(np.load(HERE / 'stream.npz')['raw'].tobytes())\n"
    )
    (folder / "test_recorded.py").write_text(
        "import lidario\nimport pytest\n\n\n"
        '@pytest.mark.lidar_recording("run.bin")\n'
        "def test_every_scan(lidar_recording):\n"
        "    assert len(lidar_recording.scans) > 2\n"
        "    assert all(scan.nearest() for scan in lidar_recording.scans)\n\n\n"
        "@pytest.mark.asyncio\n"
        '@pytest.mark.lidar_recording("run.bin")\n'
        "async def test_as_a_source(lidar_recording):\n"
        "    async with lidario.open_lidar(lidar_recording.source) as lidar:\n"
        "        assert (await lidar.scan()).nearest() is not None\n\n\n"
        '@pytest.mark.lidar_recording("gone.mcap")\n'
        "def test_not_there(lidar_recording):\n    pass\n\n\n"
        "def test_no_name(lidar_recording):\n    pass\n"
    )
    result = run(robot, "-p", "no:anyio", "tests")
    result.assert_outcomes(passed=2, errors=2)
    result.stdout.fnmatch_lines(["*there is no recording *gone.mcap*", "*@pytest.mark.lidar_recording(*run.mcap*"])


def test_what_is_written_wrong_in_the_marker_is_named(robot: pytest.Pytester) -> None:
    robot.makepyfile(
        test_wrong="""
        import pytest

        @pytest.mark.simulated_lidar("no-such-model")
        def test_model(simulated_lidar):
            pass

        @pytest.mark.simulated_lidar(fault="rain:3s")
        def test_fault(simulated_lidar):
            pass
        """
    )
    result = run(robot, "-p", "no:asyncio")
    result.assert_outcomes(errors=2)
    result.stdout.fnmatch_lines(["*InvalidValue*no-such-model*", "*InvalidValue*rain*"])


def test_a_run_that_does_not_use_it_imports_nothing_of_it() -> None:
    program = (
        "import sys, pytest\nimport lidario.testing.plugin, lidario.testing\n"
        "print([name for name in sys.modules if name.split('.')[0] in ('lidario', 'numpy', 'asyncio', 'anyio')])"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    found = set(re.findall(r"'([\w.]+)'", done.stdout))
    assert {name for name in found if name.startswith("lidario")} == {
        "lidario",
        "lidario.testing",
        "lidario.testing.plugin",
        "lidario.version",
    }
    assert not found & {"numpy", "asyncio", "anyio"}


def test_pytest_is_told_of_it() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert '[project.entry-points.pytest11]\nlidario = "lidario.testing.plugin"\n' in text
