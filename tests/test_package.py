"""What is published: wheel, sdist and the package page hold all that they must, and every extra named is one."""

import email
import importlib.util
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any

import pytest

from lidario import __version__

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
MADE = [line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").split()]
FOLDERS = ("lidario", "tests", "docs", "examples", "benchmarks", ".ci", ".github")
TEXTS = sorted(
    path
    for folder in (*FOLDERS, "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "Makefile")
    for path in ([ROOT / folder] if (ROOT / folder).is_file() else (ROOT / folder).rglob("*"))
    if path.suffix in {".py", ".md", ".yml", ".ipynb", ".html", ""} and path.is_file()
    # What benchmarks install is not ours.
    if ".peers" not in path.parts
)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a wheel and an sdist, made by what pip makes them with."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=120)
    return folder


@pytest.fixture(scope="module")
def wheel(built: Path) -> zipfile.ZipFile:
    (path,) = built.glob("*.whl")
    assert path.name == f"lidario_asyncio-{__version__}-py3-none-any.whl"
    return zipfile.ZipFile(path)


def ours(folder: str) -> set[str]:
    """The files below a folder of the repository, but for those that commands make."""
    names = {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("*") if path.is_file()}
    return {
        name
        for name in names
        if not any(fnmatch(part, made) for part in PurePosixPath(name).parts for made in MADE)
        and not any(name.startswith(f"{made}/") for made in MADE)
    }


@pytest.mark.long
def test_the_wheel_holds_the_package_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert {"lidario/py.typed", "lidario/web/page.html", "lidario/testing/plugin.py"} <= names
    assert names == ours("lidario")


@pytest.mark.long
def test_the_wheel_says_what_it_needs_and_what_it_brings(wheel: zipfile.ZipFile) -> None:
    (home,) = {name.partition("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    said = email.message_from_bytes(wheel.read(f"{home}/METADATA"))
    assert (said["Name"], said["Version"]) == ("lidario-asyncio", __version__)
    assert set(said.get_all("Provides-Extra", [])) == set(EXTRAS)
    always = {re.split(r"[^\w-]", text)[0] for text in said.get_all("Requires-Dist", []) if "extra ==" not in text}
    assert always == {"numpy", "pyserial-asyncio", "anyio"}
    assert "lidario = lidario.__main__:main" in wheel.read(f"{home}/entry_points.txt").decode()
    assert b"MIT License" in wheel.read(f"{home}/licenses/LICENSE")


@pytest.mark.long
def test_the_sdist_holds_what_its_tests_need(built: Path) -> None:
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    missing = {name for folder in FOLDERS for name in ours(folder)} - names
    assert not missing
    assert {"pyproject.toml", "README.md", "CHANGELOG.md", "LICENSE", "Makefile", ".gitignore"} <= names


def named_extras() -> list[tuple[str, str]]:
    """Each place that names an extra: the file, and the extras as it writes them."""
    pattern = re.compile(r"(?:lidario-asyncio|['\" ]\.)\[([\w, -]+)\]")
    return sorted(
        {
            (path.relative_to(ROOT).as_posix(), extras)
            for path in TEXTS
            for extras in pattern.findall(path.read_text(encoding="utf-8"))
        }
    )


@pytest.mark.long
def test_every_extra_that_a_text_names_is_one() -> None:
    named = named_extras()
    assert {"README.md", "docs/index.md", "CONTRIBUTING.md", "Makefile"} <= {file for file, _ in named}
    wrong = [(file, extras) for file, extras in named if not set(re.split(r",\s*", extras)) <= set(EXTRAS)]
    assert not wrong


def requirements(extra: str) -> set[str]:
    """The names of the packages that an extra brings, those of the extras in it too."""
    found: set[str] = set()
    for text in EXTRAS[extra]:
        if inner := re.match(r"lidario-asyncio\[([\w,-]+)\]", text):
            found = found.union(*(requirements(name) for name in inner[1].split(",")))
        else:
            found.add(re.split(r"[^\w.-]", text)[0])
    return found


def test_what_an_error_tells_to_install_is_what_an_extra_brings() -> None:
    """Package by package, so that it holds in a clone and with a package from PyPI."""
    users = {extra: requirements(extra) for extra in EXTRAS if extra not in ("test", "dev")}
    told: dict[str, str] = {}
    for path in (ROOT / "lidario").rglob("*.py"):
        for words in re.findall(r"pip install ((?:[\w-]+)(?: [\w-]+)*)", path.read_text(encoding="utf-8")):
            told[words] = path.name
    assert "click rich websockets mcap" in told
    for words, file in told.items():
        assert any(set(words.split()) <= brought for brought in users.values()), (words, file)


ADDRESS = "https://example.org/acme/lidario"


@pytest.fixture
def hook(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The hook of the build, without the builder, which is only there while a package is built."""
    plugin = ModuleType("hatchling.metadata.plugin.interface")
    plugin.MetadataHookInterface = object  # type: ignore[attr-defined]
    for name in ("hatchling", "hatchling.metadata", "hatchling.metadata.plugin"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, plugin.__name__, plugin)
    for name in ("GITHUB_REPOSITORY", "GITHUB_SERVER_URL", "LIDARIO_REPOSITORY"):
        monkeypatch.delenv(name, raising=False)
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def page_of(hook: Any) -> dict[str, Any]:
    metadata: dict[str, Any] = {}
    hook.PackagePage().update(metadata)
    return metadata


@pytest.mark.parametrize(
    "environment",
    [
        {"LIDARIO_REPOSITORY": ADDRESS + "/"},
        {"GITHUB_SERVER_URL": "https://example.org", "GITHUB_REPOSITORY": "acme/lidario"},
    ],
)
def test_everything_leads_to_the_repository(
    hook: Any, environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    metadata = page_of(hook)
    assert set(metadata["urls"]) == {"Source", "Documentation", "Changelog", "Issues"}
    assert all(each.startswith(ADDRESS) for each in metadata["urls"].values())
    text = metadata["readme"]["text"]
    targets = re.findall(r"\]\(([^)]+)\)", text)
    files = [target for target in targets if not target.startswith("#")]
    assert len(files) > 20
    for target in files:
        kind, _, path = target.removeprefix(ADDRESS + "/").partition("/HEAD/")
        assert kind == ("raw" if path.endswith(".png") else "blob"), target
        assert (ROOT / path.partition("#")[0]).exists(), target


def test_where_no_address_is_known_it_is_the_file(hook: Any) -> None:
    assert page_of(hook) == {
        "readme": {"content-type": "text/markdown", "text": (ROOT / "README.md").read_text(encoding="utf-8")}
    }
