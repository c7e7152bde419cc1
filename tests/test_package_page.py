"""What the package page shows: every picture and link of README leads to the repository, where that is known."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
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


def built(hook: Any) -> dict[str, Any]:
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
    metadata = built(hook)
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
    assert built(hook) == {
        "readme": {"content-type": "text/markdown", "text": (ROOT / "README.md").read_text(encoding="utf-8")}
    }
