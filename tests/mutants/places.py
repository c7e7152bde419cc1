"""Where a source can be changed by a little, and how: what `tests.mutants` chooses from."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from typing import Final, NamedTuple

_TURNED: Final = {
    "<": ">=",
    "<=": ">",
    ">": "<=",
    ">=": "<",
    "==": "!=",
    "!=": "==",
    "is": "is not",
    "is not": "is",
    "in": "not in",
    "not in": "in",
}
_COMPARISON: Final = re.compile(rb"<=|>=|==|!=|<|>|\bis\s+not\b|\bnot\s+in\b|\bis\b|\bin\b")
_MESSAGES: Final = ("log", "_log", "logger", "warnings")
_ONE_IS_NOTHING: Final = 1e6
"""Of a number so large, such as a unit of time, one more is no other number."""


class Place(NamedTuple):
    """A change of one line.

    Attributes:
        path: The file, from the folder of the repository.
        line: The line, from 1.
        start: The first byte of the line that goes.
        end: The byte behind the last one that goes.
        new: What stands there instead.
        kind: What kind of change it is.
    """

    path: str
    line: int
    start: int
    end: int
    new: str
    kind: str

    def changed(self, source: bytes) -> bytes:
        """The source with the change."""
        lines = source.splitlines(keepends=True)
        line = lines[self.line - 1]
        lines[self.line - 1] = line[: self.start] + self.new.encode() + line[self.end :]
        return b"".join(lines)

    def lines(self, source: bytes) -> tuple[str, str]:
        """The line before and after the change."""
        before, after = (text.splitlines()[self.line - 1].decode() for text in (source, self.changed(source)))
        return before.strip(), after.strip()


def places_of(path: str, source: bytes) -> list[Place]:
    """All places of a file that can be changed; none in annotations, messages, and what no test should notice."""
    tree = ast.parse(source)
    lines = source.splitlines()
    names = [node for node, _ in _walk(tree, False) if isinstance(node, ast.Name)]
    used = {node.id for node in names if isinstance(node.ctx, ast.Load)}
    tree.body = [node for node in tree.body if not _is_only_shown(node, used)]
    return [
        Place(path, *change)
        for node, says_bool in _walk(tree, False)
        for change in _changes(node, lines, says_bool)
    ]


def _walk(node: ast.AST, says_bool: bool) -> Iterator[tuple[ast.AST, bool]]:
    """All that runs, each with whether its function returns a bool."""
    if isinstance(node, (ast.Raise, ast.JoinedStr)) or _is_message(node):
        return
    yield node, says_bool
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
        says_bool = isinstance(node.returns, ast.Name) and node.returns.id == "bool"
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _walk(child, says_bool)


def _is_message(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and isinstance(node.func.value, ast.Name)
        and node.func.value.id in _MESSAGES
    )


def _is_only_shown(node: ast.stmt, used: set[str]) -> bool:
    """Whether it sets a private constant that nothing but messages use."""
    return (
        isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Name)
        and node.target.id.startswith("_")
        and node.target.id not in used
    )


def _changes(node: ast.AST, lines: list[bytes], says_bool: bool) -> Iterator[tuple[int, int, int, str, str]]:
    """Line, first byte, end, new text and kind of each change of this node."""
    if isinstance(node, ast.Compare):
        for left, right in zip([node.left, *node.comparators], node.comparators, strict=False):
            if at := _between(left, right, lines, _COMPARISON):
                old = " ".join(lines[at[0] - 1][at[1] : at[2]].decode().split())
                yield *at, _TURNED[old], "comparison"
    elif isinstance(node, ast.BoolOp):
        new = "or" if isinstance(node.op, ast.And) else "and"
        for left, right in zip(node.values, node.values[1:], strict=False):
            if at := _between(left, right, lines, re.compile(rb"\b(and|or)\b")):
                yield *at, new, "and, or"
    elif isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Sub)):
        if at := _between(node.left, node.right, lines, re.compile(rb"[+-]")):
            yield *at, "-" if isinstance(node.op, ast.Add) else "+", "sign"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        found = re.compile(rb"not\s*").match(lines[node.lineno - 1], node.col_offset)
        if found:
            yield node.lineno, *found.span(), "", "not"
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.end_col_offset is not None:
        value = node.value
        assert isinstance(value, (int, float))
        more = [repr(value + 1)] if value < _ONE_IS_NOTHING else []
        for new in dict.fromkeys([*more, repr(value * 2 or 1)]):
            yield node.lineno, node.col_offset, node.end_col_offset, new, "number"
    elif isinstance(node, (ast.Expr, ast.Return)) and node.lineno == node.end_lineno:
        yield from _left_out(node, lines, says_bool)


def _left_out(
    node: ast.Expr | ast.Return, lines: list[bytes], says_bool: bool
) -> Iterator[tuple[int, int, int, str, str]]:
    """A call that is not made; a value that is not returned, or the opposite of it."""
    assert node.end_col_offset is not None
    value, at = node.value, (node.lineno, node.col_offset, node.end_col_offset)
    if isinstance(node, ast.Expr):
        call = value.value if isinstance(value, ast.Await) else value
        if isinstance(call, ast.Call) and not _is_message(call):
            yield *at, "pass", "call"
    elif value is not None and not (isinstance(value, ast.Constant) and value.value is None):
        said = lines[node.lineno - 1][node.col_offset : node.end_col_offset].decode().removeprefix("return").strip()
        yield *at, f"return not ({said})" if says_bool else "return None", "return"


def _between(
    left: ast.expr, right: ast.expr, lines: list[bytes], pattern: re.Pattern[bytes]
) -> tuple[int, int, int] | None:
    """Where the operator between two operands is, if they are on one line."""
    if left.end_lineno != right.lineno or left.end_col_offset is None:
        return None
    found = pattern.search(lines[right.lineno - 1], left.end_col_offset, right.col_offset)
    return None if found is None else (right.lineno, found.start(), found.end())
