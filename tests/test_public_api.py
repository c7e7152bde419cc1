"""What a user may rely on: the names, their documentation and types, and how little importing them costs."""

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Protocol

import pytest

import lidario
from lidario import filters
from tests.support.children import ended

API = Path(__file__).parent.parent / "docs" / "api"
DOCUMENTED = [
    name for path in API.glob("*.md") for name in re.findall(r"(?m)^::: lidario\.(\w+)$", path.read_text("utf-8"))
]
PUBLIC = sorted({*DOCUMENTED, "__version__"} - {"errors"})
"""What the pages of the API promise; `errors` is a module, shown for its tree."""
ALIASES = {"BeamOrder", "ConnectReason", "Motion", "NoReturn", "PoseFunction", "Preset", "Tap", "Wall"}
"""Type aliases: they carry no docstring at run time."""


def test_the_public_names() -> None:
    assert lidario.__all__ == PUBLIC
    assert len(DOCUMENTED) == len(PUBLIC) > 80
    for name in PUBLIC:
        assert hasattr(lidario, name)


def names_in(annotation: ast.AST | None) -> set[str]:
    """Every name in an annotation, those in quotation marks included."""
    if annotation is None:
        return set()
    found = {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)}
    for node in ast.walk(annotation):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            found.add(node.value)
    return found


def annotations_of(thing: ast.AST, *, constructed: bool) -> set[str]:
    """Every name in what a user can call or read of a function or class.

    The constructors of a session's classes are not for users; those of errors and records are.
    """
    if isinstance(thing, ast.FunctionDef | ast.AsyncFunctionDef):
        every = thing.args
        given = [*every.posonlyargs, *every.args, *every.kwonlyargs, every.vararg, every.kwarg]
        return names_in(thing.returns).union(*(names_in(each.annotation) for each in given if each is not None))
    if not isinstance(thing, ast.ClassDef):
        return set()
    found: set[str] = set().union(*(names_in(base) for base in thing.bases))
    for member in thing.body:
        if isinstance(member, ast.AnnAssign) and isinstance(member.target, ast.Name):
            found |= set() if member.target.id.startswith("_") else names_in(member.annotation)
        elif isinstance(member, ast.FunctionDef | ast.AsyncFunctionDef):
            dunder = member.name.startswith("__") and (member.name != "__init__" or constructed)
            if dunder or not member.name.startswith("_"):
                found |= annotations_of(member, constructed=constructed)
    return found


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def hidden_bases(thing: object) -> list[type]:
    """The classes of ours that a public class inherits from, and that have no public name themselves."""
    bases = thing.__mro__[1:] if isinstance(thing, type) else ()
    return [base for base in bases if base.__module__.startswith("lidario.") and base.__name__ not in PUBLIC]


def names_not_public(things: Sequence[ast.AST], path: Path, *, constructed: bool) -> set[str]:
    named = set().union(*(annotations_of(thing, constructed=constructed) for thing in things))
    return {each for each in named & ours_in(path) if each not in PUBLIC and each not in filters.__all__}


@cache
def ours_in(path: Path) -> set[str]:
    """Classes that a module defines, and names that it imports from another of ours, for type checkers included."""
    found = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("lidario"):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ClassDef):
            found.add(node.name)
    return found


@pytest.mark.parametrize("name", [name for name in PUBLIC if name not in {"__version__", *ALIASES}])
def test_what_stands_in_public_signatures_is_public(name: str) -> None:
    thing = getattr(lidario, name)
    path = Path(inspect.getfile(thing))
    things = [node for node in parsed(path).body if getattr(node, "name", "") == name]
    assert things
    constructed = path.stem in ("errors", "model", "laserscan", "points", "scan")
    missing = names_not_public(things, path, constructed=constructed)
    # What it inherits from a class of ours without a public name is as public as its own.
    for base in hidden_bases(thing):
        missing.discard(base.__name__)
        home_of_base = Path(inspect.getfile(base))
        inherited = [node for node in parsed(home_of_base).body if getattr(node, "name", "") == base.__name__]
        missing |= names_not_public(inherited, home_of_base, constructed=False)
    assert not missing, f"{name} names {missing}, which cannot be imported from lidario"


EXTRAS = {"click", "rich", "mcap", "websockets", "zenoh", "matplotlib", "lidario.cli"}
LOADED = "print(*sorted(sys.modules))"


def test_importing_costs_next_to_nothing() -> None:
    loaded = set(ended(f"import lidario, sys; {LOADED}").stdout.split())
    assert "lidario" in loaded
    assert not loaded & (EXTRAS | {"numpy", "serial", "anyio"})


def test_a_room_is_found_without_an_import_of_its_own() -> None:
    for room in ("conformance", "errors", "filters", "ros", "testing"):
        assert ended(f"import lidario; print(lidario.{room}.__name__)").stdout.split() == [f"lidario.{room}"]


@pytest.mark.long
def test_the_command_waits_for_numpy_only_where_it_is_used() -> None:
    # The shell runs it at each completion.
    loaded = set(ended(f"import lidario.cli.main, sys; {LOADED}").stdout.split())
    assert not loaded & {"numpy", "rich.console", "serial", "lidario.session.lidar"}


@pytest.mark.long
def test_no_public_name_brings_an_extra_along() -> None:
    loaded = set(ended(f"from lidario import *; import sys; {LOADED}").stdout.split())
    assert {"numpy", "lidario.session.lidar"} <= loaded
    assert not loaded & EXTRAS
    # Nor the simulator, which only few need.
    assert not any(name.startswith("lidario.families") and ".simulated" in name for name in loaded)


def test_what_is_not_public_is_not_there() -> None:
    assert set(PUBLIC) <= set(dir(lidario))
    with pytest.raises(AttributeError, match="no attribute 'Assembler'"):
        lidario.Assembler  # noqa: B018


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
