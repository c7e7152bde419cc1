"""The connection to a zenoh router: what is asked of the package, with a session of ours in its place."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from lidario.network import bus as under_test
from lidario.network.bus import Bus

ROUTER = "tcp/192.0.2.7:7447"


class Session:
    """What `Bus` uses of a session of zenoh."""

    def __init__(self) -> None:
        self.receive: Callable[[Any], None] = lambda _: None
        self.released = threading.Event()
        self.info = SimpleNamespace(declare_transport_events_listener=lambda _: None)

    def declare_subscriber(self, _: str, receive: Callable[[Any], None]) -> SimpleNamespace:
        self.receive = receive
        return SimpleNamespace(undeclare=lambda: None)

    def close(self) -> None:
        self.released.wait()


async def test_leaving_a_router_that_does_not_respond_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(under_test, "CLOSE_S", 0.02)
    session = Session()
    try:
        async with asyncio.timeout(30):
            await Bus(session, ROUTER).close()
    finally:
        session.released.set()


@pytest.mark.parametrize("file", ["", '{mode: "peer", scouting: {multicast: {enabled: true}}}'], ids=["", "a file"])
async def test_only_the_router_that_was_named_is_connected_to(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, file: str
) -> None:
    """Whatever the environment names as configuration."""
    monkeypatch.delenv("ZENOH_CONFIG", raising=False)
    if file:
        (tmp_path / "zenoh.json5").write_text(file)
        monkeypatch.setenv("ZENOH_CONFIG", str(tmp_path / "zenoh.json5"))
    opened = Mock(return_value=Session())
    monkeypatch.setattr("zenoh.open", opened)
    await Bus.open(ROUTER)
    (config,) = opened.call_args.args
    assert config.get_json("mode") == '"client"'
    assert config.get_json("connect/endpoints") == f'["{ROUTER}"]'
    assert config.get_json("scouting/multicast/enabled") == "false"
