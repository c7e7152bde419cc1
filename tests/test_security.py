"""What SECURITY.md promises: the tests it names exist, and those promises that no other test holds."""

import ast
import socket
from pathlib import Path

import pytest

from lidario import simulate
from lidario.cli.sim import name_of, server_of
from lidario.sim.serve import TcpServer
from tests.support.children import ended
from tests.support.devices import both_families, change_info, make_rig
from tests.support.loop import driven

ROOT = Path(__file__).parent.parent
RISKY = {"eval", "exec", "pickle", "marshal", "shelve", "system", "popen", "yaml"}
ESCAPES = b"\x1b[2J\x1b]0;x\x07\r\n\x00\xe2\x80\xae"


def test_a_served_device_listens_on_the_loopback_interface() -> None:
    device = simulate()
    with TcpServer(device) as server:
        assert server.address[0] == "127.0.0.1"
    with server_of(device, pty=False, tcp=":0") as served:
        assert name_of(served).startswith("tcp://127.0.0.1:")


@pytest.mark.long
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
            found = used & RISKY
            assert not found, f"{path}: {found}"


VERBS = """
import os, signal, sys
from tests.cli.processes import invoke, invoke_driven

connected, told = [], ("socket.connect", "socket.sendto", "socket.sendmsg", "socket.getaddrinfo", "urllib.Request")

def watch(event, arguments):
    if event in told:
        where = arguments[1] if event.startswith("socket.connect") else arguments[0]
        connected.append((event, where))
        if where == ("192.0.2.1", 9):
            os.kill(os.getpid(), signal.SIGINT)  # the page is there, and its address is about to be told

port, folder = sys.argv[1:]
os.chdir(folder)
sys.addaudithook(watch)
memory = "sim://rplidar-s2?via=memory"
for words in (
    "", "--version", "devices", "udev", "completion bash", "completion zsh", "sim --list", f"info {memory}",
    f"scan {memory} -n 1", f"plot {memory}", f"stats {memory} -t 1s", f"doctor {memory}", f"motor start {memory}",
    f"motor stop {memory}", f"record {memory} -n 2 -o a.mcap", "info a.mcap", "export a.mcap a.npz",
    "scan a.mcap?rate=0 -n 1", "scan auto", "info id:0000",
):
    done = (invoke_driven if memory in words else invoke)(*words.split())
    assert done.exit_code in (0, 3), (words, done.exit_code, done.stderr)
assert invoke(*f"view {memory} --port 0 --lan".split()).exit_code == 0
invoke(*f"info tcp://127.0.0.1:{port}".split())
for each in connected:
    print(*each)
"""


@pytest.mark.long
def test_the_verbs_connect_to_what_a_source_names_and_to_nothing_else(tmp_path: Path) -> None:
    """Every verb under an audit hook. The peer that a source names is seen, so the hook does see.

    192.0.2.1 is an address for documentation, where nobody is. ``view --lan`` names it to the system, to learn by
    which address this machine is reached, and sends nothing.
    """
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    done = ended(VERBS, str(port), str(tmp_path))
    assert done.returncode == 0, done.stderr
    seen = done.stdout.splitlines()
    named = f"socket.connect ('127.0.0.1', {port})"
    assert named in seen
    assert set(seen) <= {named, "socket.connect ('192.0.2.1', 9)", "socket.getaddrinfo 127.0.0.1"}, seen


@both_families
@driven
async def test_texts_from_a_device_can_be_shown(family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_rig(family)
    change_info(rig, lambda payload: payload[:4] + ESCAPES.ljust(len(payload) - 4, b"\x1b"), monkeypatch)
    async with rig.open() as lidar:
        info = lidar.info
        for text in (info.model, info.firmware, info.serial, repr(lidar), str(info)):
            assert text.isprintable(), ascii(text)
