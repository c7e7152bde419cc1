"""CONTRIBUTING.md names what is there: files, folders, make targets, options, names in the source."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
CODE = re.findall(r"`([^`\n]+)`", TEXT)
MADE = (ROOT / ".gitignore").read_text(encoding="utf-8").split()
"""What commands make, so that it need not be there."""
PATHS = sorted(
    {word for word in CODE if re.fullmatch(r"[\w./]+/[\w./]*", word) and word.split("/")[0] + "/" not in MADE}
)
FAMILY_FILES = ("formats.py", "decode.py", "device.py", "simulated/", "__init__.py")
FAMILIES = [path.parent for path in sorted((ROOT / "lidario" / "families").glob("*/device.py"))]


def test_something_is_found_to_test() -> None:
    assert {".ci/run", "lidario/wire/", "tests/support/loop.py", "tests/data/"} <= set(PATHS)
    assert len(PATHS) > 15
    assert len(FAMILIES) >= 2


def test_every_path_is_there() -> None:
    """In the recipes a path may begin in the folder of a family, and NAME stands for a new one."""
    beside = [(folder, family.name) for family in FAMILIES for folder in (ROOT, family)]
    assert [
        path for path in PATHS if not any((folder / path.replace("NAME", name)).exists() for folder, name in beside)
    ] == []
    for file in FAMILY_FILES:
        assert f"`{file}`" in TEXT
        assert all((family / file).exists() for family in FAMILIES), file


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/architecture.md"])
def test_every_room_is_in_the_table(page: str) -> None:
    rooms = {path.parent.name for path in (ROOT / "lidario").glob("*/__init__.py")}
    text = (ROOT / page).read_text(encoding="utf-8")
    assert rooms == set(re.findall(r"^\| `lidario/(\w+)/` \|", text, re.MULTILINE))


def test_every_target_is_one_of_make() -> None:
    lines = re.findall(r"^(\w[\w ]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    targets = {name for line in lines for name in line.split()}
    named = {word.split()[1] for word in CODE if word.startswith("make ")}
    assert {"test", "check"} <= named <= targets


def test_the_options_are_options(pytestconfig: pytest.Config) -> None:
    options = re.findall(r"`(--[\w-]+)", TEXT)
    assert "--every-step" in options
    for option in options:
        assert pytestconfig.getoption(option) is not None
    assert "HYPOTHESIS_PROFILE" in (ROOT / "tests" / "conftest.py").read_text(encoding="utf-8")


def test_every_name_is_defined_where_it_is_said_to_be() -> None:
    for name, file in {
        "FORMATS": "lidario/families/rplidar/formats.py",
        "DECODERS": "lidario/families/rplidar/decode.py",
        "FAMILIES": "lidario/families/registry.py",
        "FAMILY": "lidario/families/rplidar/__init__.py",
        "CASES": "tests/families/rplidar/about.py",
        "MAKER": "tests/families/rplidar/about.py",
        "both_families": "tests/support/devices.py",
    }.items():
        assert f"`{name}`" in TEXT
        assert re.search(rf"^{name}\b.* = ", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), name
