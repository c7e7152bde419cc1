"""Which tests run a line: only they can notice a change of it.

The database is what ``pytest -n 2 --long --cov --cov-context=test --cov-report=`` writes.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from coverage import CoverageData

from tests.mutants.places import Place

MOST_TESTS: Final = 800
"""Of more tests that run a line, so many are taken: to find and run more takes minutes."""


class Covering:
    """Which tests run which lines.

    Args:
        database: The file.
        root: The folder whose tests were measured.
    """

    def __init__(self, database: Path, root: Path) -> None:
        self._data = CoverageData(basename=str(database))
        self._data.read()
        self._root = root

    def is_run(self, place: Place) -> bool:
        """Whether any test runs the line, and not the import alone."""
        path = self._root / place.path
        tree = ast.parse(path.read_bytes())
        return _is_in_function(tree, place.line) and bool(self._tests_of(path, _lines(tree, place)))

    def tests(self, place: Place, nearest: Sequence[str]) -> list[list[str]]:
        """The tests that run the line: those of the `nearest` folders and modules, then the others.

        pytest orders those of one run by their fixtures, and not as they are named. Of a line that runs while its
        module is imported, those that run a line that names what it defines.
        """
        path = self._root / place.path
        tree = ast.parse(path.read_bytes())
        found = self._tests_of(path, _lines(tree, place))
        if not found and (names := _defined(_statement(tree, place.line))):
            for user in sorted((self._root / "lidario").rglob("*.py")):
                if lines := _naming(user, names):
                    found |= self._tests_of(user, lines)

        near, far = list[str](), list[str]()
        for test in sorted(found or self._tests_of(path, None)):
            module = test.partition("::")[0]
            is_near = any(module == folder or module.startswith(f"{folder}/") for folder in nearest)
            (near if is_near else far).append(test)
        return [_some(tests) for tests in (near, far) if tests]

    def importing(self, place: Place) -> list[str]:
        """The test modules that import what is defined there: they may read it, and run no line of the file."""
        names = _defined(_statement(ast.parse((self._root / place.path).read_bytes()), place.line))
        module = place.path.removesuffix(".py").replace("/", ".")
        modules = sorted((self._root / "tests").rglob("test_*.py"))
        return [path.relative_to(self._root).as_posix() for path in modules if _imports(path, module, names)]

    def _tests_of(self, path: Path, lines: Iterable[int] | None) -> set[str]:
        """The tests that run some of these lines of a file; None for any line."""
        contexts = self._data.contexts_by_lineno(str(path))
        these = contexts if lines is None else contexts.keys() & set(lines)
        return {context.rpartition("|")[0] for line in these for context in contexts[line] if context}


def _some(tests: Sequence[str]) -> list[str]:
    """At most `MOST_TESTS` of them: one case of each test before any other case, and of too many, evenly."""
    first = {test.partition("[")[0]: test for test in reversed(tests)}
    ones = sorted(first.values())
    others = sorted(set(tests) - set(ones)) if len(ones) < MOST_TESTS else []
    return sorted([*_evenly(ones, MOST_TESTS), *_evenly(others, MOST_TESTS - len(ones))])


def _evenly(tests: Sequence[str], most: int) -> Sequence[str]:
    return tests[:: -(-len(tests) // most)] if tests else ()


def _statement(tree: ast.Module, line: int) -> ast.stmt:
    """The smallest statement on that line."""
    around: ast.stmt = tree.body[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or line):
            # Walked from the outside inwards: the last one is the smallest.
            around = node
    return around


def _is_in_function(tree: ast.Module, line: int) -> bool:
    """What stands elsewhere may hold a lambda that tests run, and is run itself by the import."""
    functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
    return any(each.body[0].lineno <= line <= (each.end_lineno or line) for each in functions)


def _lines(tree: ast.Module, place: Place) -> range:
    statement = _statement(tree, place.line)
    return range(statement.lineno, _head_end(statement))


def _head_end(statement: ast.stmt) -> int:
    """The line behind a statement; of one that has a body, behind what stands before that."""
    body = getattr(statement, "body", None)
    end = statement.end_lineno or statement.lineno
    return max(statement.lineno + 1, body[0].lineno if body else end + 1)


def _defined(statement: ast.stmt) -> set[str]:
    """The names that a statement gives a value."""
    targets = getattr(statement, "targets", None) or [getattr(statement, "target", None)]
    return {name.id for target in targets if target for name in ast.walk(target) if isinstance(name, ast.Name)}


def _imports(path: Path, module: str, names: set[str]) -> bool:
    """Whether a file imports one of the names from that module."""
    text = path.read_text(encoding="utf-8")
    return f"from {module} import" in text and any(
        isinstance(node, ast.ImportFrom) and node.module == module and not names.isdisjoint(_imported(node))
        for node in ast.walk(ast.parse(text))
    )


def _imported(node: ast.ImportFrom) -> list[str]:
    return [each.name for each in node.names]


def _naming(path: Path, names: set[str]) -> list[int]:
    """The lines of a file that read one of the names, also as an attribute."""
    text = path.read_text(encoding="utf-8")
    if not any(name in text for name in names):
        return []
    found = list[int]()
    for node in ast.walk(ast.parse(text)):
        name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
        if name in names and isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
            found.append(node.lineno)
    return found
