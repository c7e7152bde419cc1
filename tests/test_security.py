"""What SECURITY.md promises: the tests it names exist, and those promises that no other test holds."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from lidario import simulate
from lidario.cli.sim import on_tcp
from lidario.sim.serve import TcpServer
from tests.support.devices import both_families, change_info, make_rig
from tests.support.loop import driven

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(test_\w+)`", TEXT)))
RISKY = {"eval", "exec", "pickle", "marshal", "shelve", "system", "popen", "yaml"}
ESCAPES = b"\x1b[2J\x1b]0;x\x07\r\n\x00\xe2\x80\xae"


def test_something_is_named() -> None:
    assert len(NAMED) > 12


@pytest.mark.parametrize("name", NAMED)
def test_a_named_test_exists(name: str) -> None:
    pattern = re.compile(rf"^(async )?def {name}\(", re.MULTILINE)
    assert any(pattern.search(path.read_text(encoding="utf-8")) for path in (ROOT / "tests").rglob("test_*.py"))


def test_a_served_device_listens_on_the_loopback_interface() -> None:
    device = simulate()
    with TcpServer(device) as server:
        assert server.address[0] == "127.0.0.1"
    with on_tcp(device, ":0", None) as server:
        assert server.address[0] == "127.0.0.1"


def test_nothing_received_is_evaluated() -> None:
    """No module of the package uses what would run a text or an object from outside."""
    for path in (ROOT / "lidario").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            used = {alias.name.partition(".")[0] for alias in node.names} if isinstance(node, ast.Import) else set()
            if isinstance(node, ast.ImportFrom):
                used = {(node.module or "").partition(".")[0]}
            elif isinstance(node, ast.Call):
                used = {getattr(node.func, "id", getattr(node.func, "attr", ""))}
                used |= {"system"} if any(word.arg == "shell" for word in node.keywords) else set()
            assert not used & RISKY, f"{path}: {used & RISKY}"


@both_families
def test_texts_from_a_device_can_be_shown(family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_rig(family)
    change_info(rig, lambda payload: payload[:4] + ESCAPES.ljust(len(payload) - 4, b"\x1b"), monkeypatch)

    @driven
    async def main() -> None:
        async with rig.open() as lidar:
            info = lidar.info
            for text in (info.model, info.firmware, info.serial, repr(lidar), str(info)):
                assert text.isprintable(), ascii(text)

    main()
