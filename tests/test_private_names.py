"""No test looks at what is private: by an attribute, by an import, or by a name in a string.

What a class keeps to itself may change without a change of what it does, and then no test should fail.
"""

import ast
import re
from pathlib import Path

import pytest

PRIVATE = re.compile(r"_[^_]\w*(?<!_)")
WORD = re.compile(r"\b_[^_\W]")
BY_STRINGS = {"__setattr__", "delattr", "getattr", "hasattr", "object", "patch", "setattr"}
"""Functions that are told the name of an attribute; two are those of `unittest.mock`."""
PUBLIC_ALL_THE_SAME = {
    "_asdict": "a method of named tuples, which would else be a field",
    "_replace": "likewise",
    "_exit": "`os._exit` is documented: it ends a process as a crash does",
    "_thread": "a module of the standard library, below `threading`, whose threads are counted",
    "_set_running_loop": "asyncio has it for event loops; a step of a coroutine that is taken by hand needs it",
}


def private_names(source: str) -> list[str]:
    """Each that a module uses of something else: of ``self``, ``cls`` and ``super()`` they are its own."""
    if not WORD.search(source):
        return []
    every = list(ast.walk(ast.parse(source)))
    private = [(name, node) for node in every for name in _names(node) if PRIVATE.fullmatch(name)]
    classes = [each for each in every if isinstance(each, ast.ClassDef)] if private else []
    own = {node for each in classes for node in ast.walk(each) if _is_own(node)}
    return sorted(name for name, node in private if node not in own and name not in PUBLIC_ALL_THE_SAME)


def _names(node: ast.AST) -> list[str]:
    """An attribute, every part of an import, or of what a string names."""
    match node:
        case ast.Attribute():
            return [node.attr]
        case ast.ImportFrom():
            return [*(node.module or "").split("."), *(alias.name for alias in node.names)]
        case ast.Import():
            return [part for alias in node.names for part in alias.name.split(".")]
        case ast.Call(func=ast.Name(id=called) | ast.Attribute(attr=called)) if called in BY_STRINGS:
            texts = [each.value for each in node.args if isinstance(each, ast.Constant)]
            return [part for text in texts if isinstance(text, str) for part in text.split(".")]
    return []


def _is_own(node: ast.AST) -> bool:
    owner = node.value if isinstance(node, ast.Attribute) else None
    owner = owner.func if isinstance(owner, ast.Call) else owner
    return isinstance(owner, ast.Name) and owner.id in ("self", "cls", "super")


@pytest.mark.long
def test_no_test_looks_at_what_is_private() -> None:
    tests = Path(__file__).parent
    found = {
        path.relative_to(tests).as_posix(): private_names(path.read_text("utf-8")) for path in tests.rglob("*.py")
    }
    assert {path: names for path, names in found.items() if names} == {}


def test_what_is_private_is_found_wherever_it_stands() -> None:
    source = """
import pytest

from lidario._a import b
from lidario.b import _b
import _c
lidar._d.e
lidar.f()._f = 1
monkeypatch.setattr("lidario.x.X._g", None)
monkeypatch.setattr(lidar, "_h", None)
getattr(lidar, "_i")
def patched(self): return self._j
"""
    assert private_names(source) == ["_a", "_b", "_c", "_d", "_f", "_g", "_h", "_i", "_j"]


def test_what_is_public_or_ones_own_is_not() -> None:
    source = """
class Own(Base):
    _a = 1
    def work(self): return self._a + super()._b() + self.__c
os._exit(1)
scan._replace(seq=1)
picture._repr_svg_()
len.__name__
parametrize("_argument", [])
"""
    assert private_names(source) == []
