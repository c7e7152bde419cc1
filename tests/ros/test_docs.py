"""What docs/ros2.md and docs/fleets.md show is run: commands and programs against a router, files by zenoh."""

import re
import runpy
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from tests.cli.processes import invoke, started
from tests.support.children import line_of
from tests.support.pages import blocks
from tests.support.recorded import record
from tests.support.router import Router

DOCS = Path(__file__).parents[2] / "docs"
PAGES = ("ros2.md", "fleets.md")
SHOWN = [block for page in PAGES for block in blocks((DOCS / page).read_text(encoding="utf-8"))]
COMMANDS = [
    line.removeprefix("$ lidario ")
    for block in SHOWN
    if block.kind == "console"
    for line in block.text.splitlines()
    if line.startswith("$ lidario ")
]


@pytest.fixture(scope="module")
def tape(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(record(tmp_path_factory.mktemp("tape") / "run.mcap", "sim://ydlidar-4ros", 12).path)


@pytest.fixture(scope="module")
def robot(tape: str, router: Router) -> Iterator[None]:
    """The robot that the pages are about."""
    words = ("--zenoh", "robots/r7/scan", "--router", router.address)
    with started("publish", f"{tape}?loop=1", *words) as process:
        assert line_of(process.stdout)
        yield


@pytest.fixture(scope="module")
def topic(tape: str, router: Router) -> Iterator[None]:
    """Another one, of ROS 2."""
    with started("publish", f"{tape}?loop=1", "--ros", "--router", router.address) as process:
        assert line_of(process.stdout)
        yield


def here(text: str, router: Router) -> str:
    return re.sub(r"tcp/[\w.]+:7447", router.address, text)


@pytest.mark.long
@pytest.mark.usefixtures("robot", "topic")
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command(
    command: str, tape: str, router: Router, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = shlex.split(here(command, router), comments=True)
    if words[0] == "publish":
        # The lidar is a recording, which has an end.
        options = [word for word in words[1:] if not word.startswith(("/dev/", "run.mcap"))]
        words = ["publish", f"{tape}?rate=0", *options]
    done = invoke(*words, code=0)
    if words[0] == "publish":
        assert re.search(r"^([4-9]|1[0-2]) scans published$", done.stderr, re.MULTILINE)
    elif words[0] == "devices":
        assert "robots/r7/scan" in done.stdout
        assert "0/scan/*/*" in done.stdout


@pytest.mark.long
@pytest.mark.usefixtures("robot")
@pytest.mark.parametrize("page", PAGES)
def test_every_program(page: str, tape: str, router: Router, tmp_path: Path) -> None:
    (program,) = (block for block in blocks((DOCS / page).read_text(encoding="utf-8")) if block.kind == "python")
    text = here(program.text, router).replace("open_lidar()", f"open_lidar({tape + '?rate=0'!r})")
    # It reads for ever; here it ends with the first scan, and finds everything near.
    text = text.replace("nearest.range < 0.5:", "nearest.range < 99:")
    text = re.sub(r"( +)print\(each.*\n", r"\g<0>\1return\n", text)
    path = tmp_path / program.title
    path.write_text(text)
    runpy.run_path(str(path))


@pytest.mark.parametrize(
    "block", [each for each in SHOWN if each.title.endswith(".json5")], ids=lambda each: each.title
)
def test_every_file_is_a_configuration_of_zenoh(block: object) -> None:
    text = getattr(block, "text", "")
    config = zenoh.Config.from_json5(text)
    for section in re.findall(r"^  (\w+):", text, re.MULTILINE):
        assert config.get_json(section) not in ("null", "{}")
