"""The plugin in a user's own run of pytest: with pytest-asyncio, with anyio, with neither; and what it costs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from tests.support.inner import ASYNCIO_INI, STRICT_INI, run_pytest

ROOT = Path(__file__).parents[2]

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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a user's program."""
    (tmp_path / "pytest.ini").write_text(STRICT_INI, encoding="utf-8")
    (tmp_path / "robot.py").write_text(ROBOT, encoding="utf-8")
    return tmp_path


def write(folder: Path, name: str, text: str) -> None:
    (folder / name).write_text(dedent(text), encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize("plugin", ["asyncio", "anyio"])
def test_the_tests_of_a_robot_developer(folder: Path, plugin: str) -> None:
    write(folder, "pytest.ini", ASYNCIO_INI if plugin == "asyncio" else STRICT_INI)
    backend = '\n\n@pytest.fixture\ndef anyio_backend():\n    return "asyncio"\n' if plugin == "anyio" else ""
    write(folder, "test_robot.py", TESTS.format(mark=f"@pytest.mark.{plugin}") + backend)
    result = run_pytest(folder, "-p", "no:anyio" if plugin == "asyncio" else "no:asyncio")
    assert result.outcomes == {"passed": 2}, result.text


@pytest.mark.long
def test_no_other_plugin_is_needed(folder: Path) -> None:
    write(
        folder,
        "test_sync.py",
        """
        import lidario
        import pytest
        from lidario.testing import make_scan

        def test_one_scan():
            assert make_scan([0.0], [0.5]).nearest().range == 0.5

        @pytest.mark.simulated_lidar(pace=100)
        def test_without_await(simulated_lidar):
            with lidario.open_sync(simulated_lidar) as lidar:
                assert lidar.scan().nearest().range == pytest.approx(2.0, abs=0.01)
        """,
    )
    result = run_pytest(folder, "-p", "no:asyncio", "-p", "no:anyio")
    assert result.outcomes == {"passed": 2}, result.text


@pytest.mark.long
def test_the_same_tests_with_another_lidar(folder: Path) -> None:
    write(
        folder,
        "test_source.py",
        """
        import pytest

        def test_what_it_opens(lidar_source):
            assert lidar_source == "/dev/ttyUSB7"
        """,
    )
    assert run_pytest(folder, "-p", "no:asyncio", "--lidar-source", "/dev/ttyUSB7").outcomes == {"passed": 1}
    assert run_pytest(folder, "-p", "no:asyncio").outcomes == {"failed": 1}


@pytest.mark.long
def test_a_recording_beside_the_tests(folder: Path) -> None:
    write(folder, "pytest.ini", ASYNCIO_INI)
    tests = folder / "tests"
    tests.mkdir()
    golden = (ROOT / "tests" / "data" / "ydlidar_4ros_room7.npz").read_bytes()
    (tests / "stream.npz").write_bytes(golden)
    (tests / "conftest.py").write_text(
        "import numpy as np\nfrom pathlib import Path\n\n"
        "HERE = Path(__file__).parent\n"
        "(HERE / 'run.bin').write_bytes(np.load(HERE / 'stream.npz')['raw'].tobytes())\n"
    )
    (tests / "test_recorded.py").write_text(
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
    result = run_pytest(folder, "-p", "no:anyio", "tests")
    assert result.outcomes == {"passed": 2, "error": 2}
    assert re.search(r"there is no recording .*gone\.mcap", result.text)
    assert '@pytest.mark.lidar_recording("run.mcap")' in result.text


@pytest.mark.long
def test_what_is_written_wrong_in_the_marker_is_named(folder: Path) -> None:
    write(
        folder,
        "test_wrong.py",
        """
        import pytest

        @pytest.mark.simulated_lidar("no-such-model")
        def test_model(simulated_lidar):
            pass

        @pytest.mark.simulated_lidar(fault="rain:3s")
        def test_fault(simulated_lidar):
            pass
        """,
    )
    result = run_pytest(folder, "-p", "no:asyncio")
    assert result.outcomes == {"error": 2}
    assert re.search(r"InvalidValue.*no-such-model", result.text)
    assert re.search(r"InvalidValue.*rain", result.text)


@pytest.mark.long
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
        "lidario.loading",
        "lidario.version",
    }
    assert not found & {"numpy", "asyncio", "anyio"}


def test_pytest_is_told_of_it() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert '[project.entry-points.pytest11]\nlidario = "lidario.testing.plugin"\n' in text
