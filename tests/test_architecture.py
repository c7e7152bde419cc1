"""docs/architecture.md tells what is there: files, names, layers, states; and the calls that a real run makes."""

import ast
import asyncio
import keyword
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import lidario
from benchmarks.walk import Call, Step, Walk, printed, walked
from lidario.session.streaming.states import TRANSITIONS

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
CODE = sorted(set(re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", TEXT, flags=re.DOTALL))))
PATHS = [word for word in CODE if re.fullmatch(r"[\w/]+(/|\.py)", word)]
NAMES = [word for word in CODE if re.fullmatch(r"(\w+\.)?\w+", word) and word not in PATHS]
EXTRACTS = re.findall(r"<!-- walk: (\w+), ([^>]+) -->\n```\n(.*?)```", TEXT, re.DOTALL)


@cache
def defined() -> set[str]:
    """Every class, function and constant of the package, and ``Class.member`` for all members."""
    found: set[str] = set()
    for path in (ROOT / "lidario").rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            found |= _bound(node)
            if isinstance(node, ast.ClassDef):
                found |= {f"{node.name}.{name}" for part in _statements(node) for name in _bound(part)}
    return found


def _statements(node: ast.stmt) -> Iterator[ast.stmt]:
    """The statements in a class, in its methods too."""
    for part in (*getattr(node, "body", ()), *getattr(node, "orelse", ()), *getattr(node, "finalbody", ())):
        yield part
        yield from _statements(part)


def _bound(node: ast.stmt) -> set[str]:
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return {node.name}
    targets = (
        node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    )
    return {target.id if isinstance(target, ast.Name) else getattr(target, "attr", "") for target in targets}


@pytest.mark.long
def test_something_is_found_to_test() -> None:
    assert len(PATHS) > 12
    assert len(NAMES) > 80
    assert {"Stopper.hang_up", "LinkStats.packets", "StreamControl.go"} <= set(NAMES)
    assert {"LINGER_S", "Port.is_forked", "ReaderStream.dropped", "Link.buffered"} <= defined()
    assert not {"Port.no_such_thing", "link"} & defined()
    assert (
        sorted(way for way, _, extract in EXTRACTS if len(lines_of(extract)) >= 3) == ["memory"] * 4 + ["pty"] * 2
    )


@pytest.mark.long
def test_everything_that_is_named_is_there() -> None:
    beside = (ROOT, ROOT / "lidario" / "families" / "rplidar")
    assert [path for path in PATHS if not any((folder / path).exists() for folder in beside)] == []
    assert [name for name in NAMES if not is_there(name)] == []


def is_there(name: str) -> bool:
    public = name.removeprefix("lidario.") if name.startswith("lidario.") else ""
    of_python = keyword.iskeyword(name) or hasattr(asyncio, name)
    owner, _, member = name.partition(".")
    inherited = bool(member) and hasattr(getattr(lidario, owner, None), member)
    return name in defined() or public in lidario.__all__ or of_python or inherited


def test_the_table_of_states_is_the_one_of_the_session() -> None:
    rows = re.findall(r"^\| ([A-Z]+) \| [^|]+ \| ([^|]+) \|$", TEXT, re.MULTILINE)
    told = {state: dict(step.split(": ") for step in steps.split(", ")) for state, steps in rows}
    assert told == {
        state.name: {event.name: after.name for event, after in steps.items()}
        for state, steps in TRANSITIONS.items()
    }


# ------------------------------------------------------------------------------------------------- the walks


class Line(NamedTuple):
    """One line of an extract."""

    name: str
    depth: int
    goes_on: bool


def lines_of(extract: str) -> list[Line]:
    lines = []
    for text in extract.splitlines():
        plain = text.lstrip(" ")
        name = plain.removeprefix("… ").split(" ")[0]
        lines.append(Line(name, (len(text) - len(plain)) // 2, plain.startswith("…")))
    return lines


def missing(extract: list[Line], steps: list[Step]) -> Line | None:
    """The first line that a walk does not have: behind the line before, and called by the line it stands under."""
    calls = [call for step in steps for call in step]
    above: list[int] = []
    at = -1
    for line in extract:
        del above[line.depth :]
        under = above[-1] if above else None
        found = next(
            (
                number
                for number in range(at + 1, len(calls))
                if (calls[number].name, calls[number].goes_on) == (line.name, line.goes_on)
                and (under is None or is_under(calls, number, under))
            ),
            None,
        )
        if found is None:
            return line
        above.append(found)
        at = found
    return None


def is_under(calls: list[Call], number: int, above: int) -> bool:
    """Whether a call was made by another one, directly or not."""
    return all(call.depth > calls[above].depth for call in calls[above + 1 : number + 1])


@cache
def walks(way: str) -> list[Walk]:
    return walked(way)


def of_runs(way: str, title: str) -> Iterator[list[Step]]:
    """The steps of each time that something happened, in up to ten runs where the times are real."""
    for run in range(10 if way == "pty" else 1):
        found = walked(way) if run else walks(way)
        yield from (steps for walk in found if title in walk.title for steps in walk.seen)


@pytest.mark.long
@pytest.mark.parametrize(("way", "title", "extract"), EXTRACTS, ids=[title for _, title, _ in EXTRACTS])
def test_the_calls_are_those_of_a_real_run(way: str, title: str, extract: str) -> None:
    lines = lines_of(extract)
    # On a busy machine bytes may come in other chunks than the extract shows: then another run is looked at.
    assert any(missing(lines, steps) is None for steps in of_runs(way, title))


def test_a_wrong_extract_is_found() -> None:
    steps = [[Call("a", 0, False), Call("b", 1, False)], [Call("c", 0, False), Call("b", 1, True)]]
    assert missing(lines_of("a\n  b\nc\n  … b  said\n"), steps) is None
    assert missing(lines_of("c\na\n"), steps) == Line("a", 0, False)
    assert missing(lines_of("a\n  c\n"), steps) == Line("c", 1, False)
    assert missing(lines_of("a\n  b\n  … b\n"), steps) == Line("b", 1, True)
    assert missing(lines_of("c\n  b\n"), steps) == Line("b", 1, False)


@pytest.mark.long
def test_a_walk_can_be_printed() -> None:
    said: list[str] = []
    title = "a request while no stream runs"
    printed(next(walk for walk in walks("memory") if walk.title == title), said.append)
    assert re.fullmatch(
        r"a request while no stream runs: \d+ calls of \d+ functions in \d+ files, in 3 steps of the loop", said[0]
    )
    assert said[1] == "  1. Questions.get_health"
    assert "  3. … Questions.get_health" in said
