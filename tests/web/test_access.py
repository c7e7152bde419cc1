"""Which requests are allowed, one by one."""

from __future__ import annotations

import pytest

from lidario.web.door import Refusal, judge

LOCAL = "localhost:8080"
TOKEN = "right-token"


def judged(token: str, path: str, hosts: list[str], origins: list[str]) -> str | int:
    verdict = judge(token, path, hosts, origins)
    return verdict.status if isinstance(verdict, Refusal) else verdict


@pytest.mark.parametrize(
    ("path", "hosts", "origins", "verdict"),
    [
        ("/", [LOCAL], [], "page"),
        ("/", ["127.0.0.1:8080"], [], "page"),
        ("/", ["[::1]:8080"], [], "page"),
        ("/?x=1", [LOCAL], [], "page"),
        # A tunnel may have another port at its other end.
        ("/live", ["localhost:9000"], ["http://localhost:9000"], "socket"),
        ("/live", [LOCAL], [f"http://{LOCAL}"], "socket"),
        ("/live", [LOCAL], [], 403),
        ("/live", [LOCAL], ["http://evil.example"], 403),
        ("/live", [LOCAL], ["http://localhost:8081"], 403),
        ("/live", [LOCAL], ["http://localhost:8080.evil.example"], 403),
        ("/live", [LOCAL], ["null"], 403),
        ("/live", [LOCAL], [f"http://{LOCAL}", "http://evil.example"], 403),
        # A foreign name that is pointed at this machine.
        ("/", ["evil.example"], [], 403),
        ("/live", ["evil.example:8080"], ["http://evil.example:8080"], 403),
        ("/", ["localhost.evil.example"], [], 403),
        ("/", [], [], 400),
        ("/", [LOCAL, LOCAL], [], 400),
        ("/", ["[::1"], [], 400),
        ("/", [""], [], 400),
        ("/../etc/passwd", [LOCAL], [], 404),
        ("/live/", [LOCAL], [f"http://{LOCAL}"], 404),
        ("//[", [LOCAL], [], 400),
    ],
)
def test_on_this_machine(path: str, hosts: list[str], origins: list[str], verdict: str | int) -> None:
    assert judged("", path, hosts, origins) == verdict


@pytest.mark.parametrize(
    ("path", "host", "origin", "verdict"),
    [
        (f"/?token={TOKEN}", "robot.lan:8080", None, "page"),
        (f"/live?token={TOKEN}", "192.168.0.7:8080", "http://192.168.0.7:8080", "socket"),
        (f"/live?token={TOKEN}", "192.168.0.7:8080", "http://evil.example", 403),
        (f"/live?token={TOKEN}", "192.168.0.7:8080", None, 403),
        ("/", "robot.lan:8080", None, 403),
        ("/?token=", "robot.lan:8080", None, 403),
        ("/?token=wrong", LOCAL, None, 403),
        ("/?token=ä", LOCAL, None, 403),
        (f"/?token=wrong&token={TOKEN}", LOCAL, None, 403),
        (f"/live?token={TOKEN}x", LOCAL, f"http://{LOCAL}", 403),
    ],
)
def test_on_a_network(path: str, host: str, origin: str | None, verdict: str | int) -> None:
    assert judged(TOKEN, path, [host], [] if origin is None else [origin]) == verdict
