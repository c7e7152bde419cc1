"""Which tests run a line: only they can notice a change of it.

The database is what ``pytest -n 2 --cov --cov-context=test --cov-report=`` writes.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from coverage import CoverageData

from tests.mutants.places import Place

__all__ = ["Covering"]

_MOST_NAMED: Final = 400
"""So many tests are named one by one. pytest is slow to find more, so then whole modules run."""


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

    def tests(self, place: Place, nearest: Sequence[str]) -> list[list[str]]:
        """The tests that run the line: those of the `nearest` folders and modules, then the others.

        pytest orders those of one run by their fixtures, and not as they are named. Of a line that runs while its
        module is imported, those that run anything of the module.
        """
        path = self._root / place.path
        contexts = self._data.contexts_by_lineno(str(path))
        statement = set(_statement(ast.parse(path.read_bytes()), place.line))
        found = _tests(contexts[line] for line in statement.intersection(contexts)) or _tests(contexts.values())

        near, far = list[str](), list[str]()
        for test in sorted(found):
            module = _module(test)
            is_near = any(module == folder or module.startswith(f"{folder}/") for folder in nearest)
            (near if is_near else far).append(test)
        return [_shortened(tests) for tests in (near, far) if tests]


def _statement(tree: ast.Module, line: int) -> range:
    """The lines of the statement on that line; of one that has a body, those before it."""
    around = range(line, line + 1)
    for node in ast.walk(tree):
        end = getattr(node, "end_lineno", line)
        if isinstance(node, ast.stmt) and node.lineno <= line <= end:
            # Walked from the outside inwards: the last one is the smallest.
            body = getattr(node, "body", None)
            around = range(node.lineno, max(node.lineno + 1, body[0].lineno if body else end + 1))
    return around


def _tests(contexts: Iterable[Iterable[str]]) -> set[str]:
    return {context.rpartition("|")[0] for each in contexts for context in each if context}


def _shortened(tests: list[str]) -> list[str]:
    return tests if len(tests) <= _MOST_NAMED else list(dict.fromkeys(map(_module, tests)))


def _module(test: str) -> str:
    return test.partition("::")[0]
