"""What tests of sessions share. The async ones run in driven time, unless they are marked ``long``."""

from __future__ import annotations

import inspect
from collections.abc import Generator
from typing import TypeVar

import pytest

from tests.support.devices import FAMILIES, Rig, make_rig
from tests.support.loop import driven

T = TypeVar("T")


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_pycollect_makeitem() -> Generator[None, T, T]:
    """Have async tests run on a driven loop. What is long has real devices: threads, terminals, sockets."""
    made = yield
    for item in made if isinstance(made, list) else ():
        is_async = isinstance(item, pytest.Function) and inspect.iscoroutinefunction(item.obj)
        if is_async and not item.get_closest_marker("long"):
            item.obj = driven(item.obj)
    return made


@pytest.fixture(params=FAMILIES)
def rig(request: pytest.FixtureRequest) -> Rig:
    """A device of each family that obeys requests, or of the models that `request` names."""
    return make_rig(request.param)


@pytest.fixture
def rplidar() -> Rig:
    """One of them."""
    return make_rig("rplidar")


@pytest.fixture
def ydlidar() -> Rig:
    """The other one."""
    return make_rig("ydlidar")
