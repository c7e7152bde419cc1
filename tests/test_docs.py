"""Every program and every command of the documentation works as it stands there; every link leads somewhere."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import lidario
import lidario.testing
from tests.support.pages import Page, blocks

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
SHOWN = [*PAGES, ROOT / "README.md"]
PRINTS = {
    "recordings.md": [
        r"^\d+ None 0$",
        r"^mine\.mcap \d+ scans, \d",
        r"^ros\.mcap \d+ scans, \d",
        r"^run\.mcap \d+ scans, \d",
        r"^with_scans\.mcap \d+ scans, \d",
    ],
    "reconnect.md": [r"^\d+ revolutions missing, 1 reconnects$"],
}
"""What the programs of a page must print, each a line."""


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.long
@pytest.mark.parametrize("path", SHOWN, ids=named)
def test_everything_it_shows_runs(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = Page(path.read_text(encoding="utf-8"), tmp_path, capsys)
    page.run()
    for line in PRINTS.get(path.name, ()):
        assert re.search(line, page.said, re.MULTILINE), f"{line}\n{page.said}"


def test_the_pages_show_something() -> None:
    kinds = [block.kind for path in SHOWN for block in blocks(path.read_text(encoding="utf-8"))]
    assert kinds.count("python") > 20
    assert kinds.count("console") > 8
    assert set(kinds) <= {"python", "console", "toml", "ini", "text", "yaml"}


@cache
def names_of_tests(path: str) -> set[str]:
    """The names of all tests below a folder, or in a file."""
    files = [ROOT / path] if path.endswith(".py") else (ROOT / path).rglob("test_*.py")
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    return set(re.findall(r"^ *(?:async )?def (test_\w+)\(", text, re.MULTILINE))


@pytest.mark.parametrize("path", [*SHOWN, ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"], ids=named)
def test_what_it_names_is_there(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (path.parent / target).exists(), target
    for name in re.findall(r"`((?:tests|lidario|examples|benchmarks|docs|\.ci|\.github)/[\w./-]+)", text):
        assert (ROOT / name.rstrip(".").replace("NAME", "rplidar")).exists(), name
    for file, name in re.findall(r"`(?:(tests/[\w/]+\.py)::)?(test_\w+)`", text):
        assert name in names_of_tests(file or "tests"), name
    assert not re.search(r"pip install ['\"]?lidario(?!-asyncio)", text)


def test_every_page_is_in_the_contents() -> None:
    contents = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r": ([\w/-]+\.md)$", contents, re.MULTILINE)
    assert sorted(listed) == sorted(str(path.relative_to(DOCS)) for path in PAGES)


def test_the_api_has_every_public_name() -> None:
    """Those of `lidario` itself: tests/test_public_api.py."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.md"))
    shown = set(re.findall(r"^::: lidario\.([\w.]+)", text, re.MULTILINE))
    assert set(lidario.testing.__all__) | names_of("ros/__init__.py") <= {name.rsplit(".", 1)[-1] for name in shown}


def names_of(path: str) -> set[str]:
    """The names that a module exports, read without importing it."""
    for node in ast.parse((ROOT / "lidario" / path).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and [ast.unparse(each) for each in node.targets] == ["__all__"]:
            return set(ast.literal_eval(node.value))
    raise AssertionError(f"{path} exports nothing")


def test_the_page_for_the_machine_names_all_that_a_device_can_be_asked() -> None:
    page = (DOCS / "robot.md").read_text(encoding="utf-8")
    public = [name for name in dir(lidario.Lidar) if not name.startswith("_")]
    assert [name for name in public if not re.search(rf"\b{name}\b", page)] == []


# ---------------------------------------------------------------------------------------------- troubleshooting


def test_every_error_that_it_explains_is_raised_somewhere() -> None:
    page = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    explained = re.findall(r"^### `([^`]+)`", page, re.MULTILINE)
    assert len(explained) >= 12
    source = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "lidario").rglob("*.py"))
    # A text that goes on in the next line.
    source = re.sub(r'"\s*\n\s*[rf]?"', "", source)
    for text in explained:
        for piece in text.split("…"):
            assert piece.strip() in source, f"no error says {piece.strip()!r}"


# ------------------------------------------------------------------------------------------------- contributing

CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/architecture.md"])
def test_every_room_is_in_the_table(page: str) -> None:
    rooms = {path.parent.name for path in (ROOT / "lidario").glob("*/__init__.py")}
    text = (ROOT / page).read_text(encoding="utf-8")
    assert rooms == set(re.findall(r"^\| `lidario/(\w+)/` \|", text, re.MULTILINE))


def test_every_target_is_one_of_make() -> None:
    lines = re.findall(r"^(\w[\w ]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    targets = {name for line in lines for name in line.split()}
    assert {"test", "check"} <= set(re.findall(r"`make ([\w-]+)[^`\n]*`", CONTRIBUTING)) <= targets


def test_the_options_are_options(pytestconfig: pytest.Config) -> None:
    options = re.findall(r"`(--[\w-]+)", CONTRIBUTING)
    assert "--every-step" in options
    for option in options:
        assert pytestconfig.getoption(option) is not None


def test_the_recipes_name_what_is_there() -> None:
    """Files of a family, and names with the files in which they are defined."""
    for name, file in {
        **dict.fromkeys(("commands.py", "formats.py", "decode.py", "device.py", "simulated/packers.py"), ""),
        "FORMATS": "lidario/families/rplidar/formats.py",
        "DECODERS": "lidario/families/rplidar/decode.py",
        "FAMILIES": "lidario/families/registry.py",
        "FAMILY": "lidario/families/rplidar/__init__.py",
        "CASES": "tests/families/rplidar/about.py",
        "MAKER": "tests/families/rplidar/about.py",
        "both_families": "tests/support/devices.py",
    }.items():
        assert f"`{name}`" in CONTRIBUTING
        text = (ROOT / (file or f"lidario/families/rplidar/{name}")).read_text(encoding="utf-8")
        assert not file or re.search(rf"^{name}\b.* = ", text, re.MULTILINE), name
