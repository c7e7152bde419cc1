"""What tests of ports share."""

import asyncio
import importlib.util
import os
from collections.abc import Iterator

import pytest
import serial_asyncio

from tests.support.ports import terminal_pair


@pytest.fixture
def ends() -> Iterator[tuple[int, int, str]]:
    """Both ends of a pseudo-terminal, the controlling one first, and the path of the other."""
    with terminal_pair() as pair:
        yield pair


@pytest.fixture
def terminal(ends: tuple[int, int, str]) -> tuple[int, str]:
    """Its controlling end, and the path of the other."""
    return ends[0], ends[2]


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the way of Windows, where not every event loop waits for a line: a thread reads by pyserial's own calls.

    pyserial-asyncio is as it is there; it asks for the system when it is loaded.
    """
    spec = importlib.util.find_spec(serial_asyncio.__name__)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with monkeypatch.context() as patch:
        patch.setattr(os, "name", "nt")
        spec.loader.exec_module(module)

    def refuse(*_: object) -> None:
        raise NotImplementedError("that event loop waits for no line")

    for name in ("serial", "sockets"):
        monkeypatch.setattr(f"lidario.port.{name}.POSIX", False)
    monkeypatch.setattr("lidario.port.serial.serial_asyncio", module)
    for name in ("add_reader", "add_writer"):
        monkeypatch.setattr(asyncio.SelectorEventLoop, name, refuse)


@pytest.fixture(params=["posix", "windows"])
def system(request: pytest.FixtureRequest) -> None:
    """Once on this system, and once as on Windows."""
    if request.param == "windows":
        request.getfixturevalue("windows")
