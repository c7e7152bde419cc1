"""Every public method says what it does: in its own words, or in those of the interface that it implements."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from typing import Protocol

import lidario

_OWN_SCRIPTS = ("__main__",)


def test_a_method_without_a_docstring_has_that_of_its_interface() -> None:
    classes = list(_classes())
    interfaces = [each for each in classes if Protocol in each.__bases__]
    silent = [
        f"{each.__module__}.{each.__name__}.{name}"
        for each in classes
        for name in _methods(each)
        if not _said(each, name, interfaces)
    ]

    assert len(classes) > 300
    assert not silent


def _classes() -> Iterator[type]:
    for found in pkgutil.walk_packages(lidario.__path__, "lidario."):
        if found.name.rpartition(".")[2] in _OWN_SCRIPTS:
            continue
        module = importlib.import_module(found.name)
        for name, each in vars(module).items():
            if inspect.isclass(each) and each.__module__ == found.name and not name.startswith("_"):
                yield each


def _methods(each: type) -> Iterator[str]:
    for name, member in vars(each).items():
        function = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        if inspect.isfunction(function) and not name.startswith("_"):
            yield name


def _said(each: type, name: str, interfaces: list[type]) -> bool:
    if any(inspect.getdoc(vars(base).get(name)) for base in each.__mro__ if name in vars(base)):
        return True
    return any(
        name in vars(interface) and all(_has(each, other) for other in _methods(interface))
        for interface in interfaces
    )


def _has(each: type, name: str) -> bool:
    """Whether its objects have it: what an interface asks for as a property may be set in ``__init__``."""
    return hasattr(each, name) or any(
        f"self.{name} = " in inspect.getsource(base) or f"self.{name}: " in inspect.getsource(base)
        for base in each.__mro__
        if base.__module__.startswith("lidario.")
    )
