"""``lidario view``: what it prints, whom it lets in, how it ends. The page itself: tests/web/test_page.py."""

import re
import signal
import socket
from urllib.request import urlopen

import pytest

from tests.cli.processes import end, invoke, invoke_driven, served, started
from tests.support.children import BOUND, line_of, until

MEMORY = "sim://rplidar-s2?via=memory"


@pytest.mark.long
def test_it_prints_the_address_serves_the_page_and_ends_with_everything_off() -> None:
    with served("rplidar-s2") as server:
        with started("view", server.path, "--port", "0") as process:
            url = line_of(process.stdout).strip()
            assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", url)
            with urlopen(url, timeout=BOUND) as page:
                assert b"<canvas" in page.read()
            assert server.device.scanning
            rest, said = end(process)
        assert (process.returncode, rest) == (0, "")
        assert re.search(r": \d+ scans?\n", said)
        assert "Traceback" not in said
        until(lambda: not server.device.scanning and not server.device.motor_on)


REACHED = [("10.0.0.5 50000 10.0.0.7 22", False), ("", True), ("", False)]
"""What SSH tells of the connection, and whether the network is let in."""


@pytest.mark.long
@pytest.mark.exhaustive("reached", sample=REACHED[:1], full=REACHED)
def test_what_is_printed(monkeypatch: pytest.MonkeyPatch, reached: tuple[str, bool]) -> None:
    ssh, lan = reached
    monkeypatch.setenv("SSH_CONNECTION", ssh)
    monkeypatch.setenv("USER", "robot")
    monkeypatch.setenv("LOGNAME", "robot")
    with started("view", MEMORY, "--port", "0", *["--lan"] * lan) as process:
        url = line_of(process.stdout).strip()
        _, said = end(process, signal.SIGTERM)
    assert process.returncode == 0
    found = re.fullmatch(r"http://([\w.-]+):(\d+)/(\?token=[\w-]{20,})?", url)
    assert found is not None
    assert bool(found[3]) is lan
    assert (found[1] != "0.0.0.0") is True
    assert ("network" in said) is lan
    assert (f"ssh -L {found[2]}:127.0.0.1:{found[2]} robot@10.0.0.7" in said) is bool(ssh)


def test_a_port_that_is_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ended = invoke("view", MEMORY, "--port", str(port), code=4)
    assert f"cannot listen on port {port}" in ended.stderr
    assert "--port 0 takes any free port" in ended.stderr


@pytest.mark.parametrize("sources", [["/dev/nosuchport"], [MEMORY, "/dev/nosuchport"]])
def test_a_port_that_is_not_there(sources: list[str]) -> None:
    ended = invoke_driven("view", "--port", "0", *sources)
    assert (ended.exit_code, ended.stdout) == (3, "")
    assert ended.stderr.startswith("error: ")
