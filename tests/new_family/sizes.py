"""How much a family is: ``python -m tests.new_family.sizes``, in a clone of the repository.

Lines of code are those that hold a token which is neither a comment nor part of a docstring; beside them stand all
lines. What a family needs beside its own folder is not counted.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

FAMILIES: Final = Path(__file__).resolve().parent.parent.parent / "lidario" / "families"
_NO_CODE: Final = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
)


class Size(NamedTuple):
    """Lines of some files.

    Attributes:
        code: Those with code.
        whole: All of them.
    """

    code: int
    whole: int


def size_of(paths: Iterable[Path]) -> Size:
    """Count the lines of some Python files."""
    code = whole = 0
    for path in paths:
        text = path.read_text(encoding="utf-8")
        lines = set[int]()
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type not in _NO_CODE:
                lines.update(range(token.start[0], token.end[0] + 1))
        for node in ast.walk(ast.parse(text)):
            if (
                isinstance(node, ast.Expr)
                and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str)
            ):
                lines.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        code, whole = code + len(lines), whole + len(text.splitlines())
    return Size(code, whole)


def sides_of(family: Path) -> tuple[Size, Size]:
    """A family without its simulated devices, and these."""
    simulated = {*family.glob("simulated.py"), *family.glob("simulated/*.py")}
    return size_of({*family.glob("*.py")} - simulated), size_of(simulated)


def main() -> int:
    """Print a row for each family, and one for each file that they share; returns the exit code."""
    print(f"{'':14}{'code':>6}{'lines':>7}   its simulated devices")
    for folder in sorted(path.parent for path in FAMILIES.glob("*/__init__.py")):
        own, simulated = sides_of(folder)
        print(f"{folder.name:14}{own.code:6}{own.whole:7}   {simulated.code}, {simulated.whole}")
    for path in sorted(FAMILIES.glob("*.py")):
        shared = size_of([path])
        print(f"{path.name:14}{shared.code:6}{shared.whole:7}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
