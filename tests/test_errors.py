"""The tree of errors: what each is, that all are exported, and that each can be copied for several readers."""

import copy
import pickle
import re
from collections.abc import Callable
from typing import get_args

import pytest

import lidario
from lidario import errors
from lidario.basics.model import Health, HealthStatus
from lidario.errors import ConnectFailed, ConnectReason, DeviceFault, InvalidValue, LidarError, ResponseTimeout


def tree(root: type[LidarError]) -> list[type[LidarError]]:
    return [root] + [each for child in root.__subclasses__() for each in tree(child)]


EVERY = [kind for kind in tree(LidarError) if kind.__module__ == errors.__name__]


def made(kind: type[LidarError]) -> LidarError:
    """An error with attributes that differ from every default."""
    if kind is ConnectFailed:
        return ConnectFailed("no such port", reason="missing")
    if kind is ResponseTimeout:
        return ResponseTimeout("GET_INFO", 0.5, 17)
    if kind is DeviceFault:
        return DeviceFault("the device reports an error", Health(HealthStatus.ERROR, 0x8001))
    return kind("what happened")


def reloaded(error: LidarError) -> object:
    return pickle.loads(pickle.dumps(error))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, reloaded])
def test_an_error_can_be_copied(copied: Callable[[LidarError], object]) -> None:
    for kind in EVERY:
        error = made(kind)
        error.add_note("seen in the cellar")
        twin = copied(error)
        assert type(twin) is kind
        assert twin is not error
        assert (str(twin), repr(twin), vars(twin)) == (str(error), repr(error), vars(error))


def test_every_error_is_exported_and_drawn_where_it_stands() -> None:
    assert {"ConnectReason", *(kind.__name__ for kind in EVERY)} <= set(lidario.__all__)
    above, drawn = list[str](), dict[str, str]()
    for lines, name in re.findall(r"^    ([│├└─ ]*)(\w+)", errors.__doc__ or "", re.MULTILINE):
        depth = len(lines) // 4
        drawn[name] = above[depth - 1] if depth else "Exception"
        above[depth:] = [name]
    assert drawn == {kind.__name__: kind.__bases__[0].__name__ for kind in EVERY}


def test_every_reason_is_explained() -> None:
    for reason in get_args(ConnectReason):
        assert f"* ``{reason}``:" in (ConnectFailed.__doc__ or "")


def test_what_an_error_tells() -> None:
    silent = ResponseTimeout("GET_INFO", 0.5)
    assert str(silent) == "no response to GET_INFO within 0.5 s: nothing arrived"
    assert (silent.request, silent.timeout, silent.noise) == ("GET_INFO", 0.5, 0)
    assert isinstance(silent, TimeoutError)
    assert ConnectFailed("x").reason == "silent"
    assert ConnectFailed("x", reason="busy").reason == "busy"
    assert "17 bytes arrived, but no response to it" in str(made(ResponseTimeout))
    assert str(ResponseTimeout("GET_INFO", 0.5, 1)).endswith("0.5 s: 1 byte arrived, but no response to it")
    fault = made(DeviceFault)
    assert str(fault) == "the device reports an error"
    assert isinstance(fault, DeviceFault)
    assert fault.health.code == 0x8001
    assert isinstance(InvalidValue("x"), ValueError)
