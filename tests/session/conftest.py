"""What tests of sessions share. The async ones run in driven time, unless they are marked ``real_time``."""

import inspect
from collections.abc import Generator, Iterator
from typing import TypeVar

import pytest

from tests.support.devices import FAMILIES, Rig, left_still_at_the_end, make_rig
from tests.support.loop import driven

T = TypeVar("T")


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_pycollect_makeitem() -> Generator[None, T, T]:
    """Have async tests run on a driven loop, but for those with real devices: threads, terminals, sockets."""
    made = yield
    for item in made if isinstance(made, list) else ():
        is_async = isinstance(item, pytest.Function) and inspect.iscoroutinefunction(item.obj)
        if is_async and not item.get_closest_marker("real_time"):
            item.obj = driven(item.obj)
    return made


@pytest.fixture(params=FAMILIES)
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    """A device of each family that obeys requests, or of the models that `request` names.

    Whatever the test does with it, it is still behind it. A test that shows something else makes its own.
    """
    with left_still_at_the_end(make_rig(request.param)) as made:
        yield made


@pytest.fixture
def rplidar() -> Iterator[Rig]:
    """One of them."""
    with left_still_at_the_end(make_rig("rplidar")) as made:
        yield made


@pytest.fixture
def ydlidar() -> Iterator[Rig]:
    """The other one."""
    with left_still_at_the_end(make_rig("ydlidar")) as made:
        yield made
