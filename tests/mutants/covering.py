"""Which tests run a line: only they can notice a change of it.

The database is what ``pytest -n 2 --cov --cov-context=test --cov-report=`` writes. Lines that run while modules are
imported belong to no test.
"""

from __future__ import annotations

from collections.abc import Sequence
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

    def tests(self, place: Place, nearest: Sequence[str]) -> list[str]:
        """The tests that run the line, those of the `nearest` folders and modules first. An import has none."""
        lines = self._data.contexts_by_lineno(str(self._root / place.path))
        found = {context.rpartition("|")[0] for context in lines.get(place.line, ()) if context}

        def rank(test: str) -> tuple[int, str]:
            module = test.partition("::")[0]
            near = (at for at, folder in enumerate(nearest) if module == folder or module.startswith(f"{folder}/"))
            return next(near, len(nearest)), module

        ordered = sorted(found, key=rank)
        return ordered if len(ordered) <= _MOST_NAMED else list(dict.fromkeys(_module(test) for test in ordered))


def _module(test: str) -> str:
    return test.partition("::")[0]
