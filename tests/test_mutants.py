"""The script that changes the source changes one line, which compiles, and the same ones for the same seed."""

from pathlib import Path

import pytest
from coverage import CoverageData

from tests.mutants.__main__ import PARTS, ROOT, choose, stages_of
from tests.mutants.covering import Covering
from tests.mutants.places import Place, places_of
from tests.support.children import ended

SOURCE = b'''"""One and 2."""

_SHOWN: Final = 3


def f(a: Literal[1]) -> bool:
    """Say 4."""
    if not a < 5 and g():
        g()
        raise ValueError(f"no {_SHOWN} + 6")
    _log.debug("%d", 7)
    return (a) - 8 is not None
'''


def test_what_runs_is_changed_and_what_is_shown_is_not() -> None:
    changes = [place.lines(SOURCE)[1] for place in places_of("f.py", SOURCE)]
    assert sorted(changes) == sorted(
        [
            "if not a < 5 or g():",
            "if a < 5 and g():",
            "if not a >= 5 and g():",
            "if not a < 6 and g():",
            "if not a < 10 and g():",
            "pass",
            "return not ((a) - 8 is not None)",
            "return (a) - 8 is None",
            "return (a) + 8 is not None",
            "return (a) - 9 is not None",
            "return (a) - 16 is not None",
        ]
    )


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
def test_every_change_is_one_line_and_compiles(part: str) -> None:
    chosen = choose(20, 1, part)
    assert len(chosen) == 20
    for place in chosen:
        source = (ROOT / place.path).read_bytes()
        before, after = source.splitlines(), place.changed(source).splitlines()
        assert [at for at, pair in enumerate(zip(before, after, strict=True), 1) if pair[0] != pair[1]] == [
            place.line
        ]
        compile(place.changed(source), place.path, "exec")


@pytest.mark.long
def test_the_same_seed_gives_the_same_changes() -> None:
    chosen = choose(100, 7, "wire")
    assert chosen != choose(100, 8, "wire")
    # Sets come in another order in each process.
    done = ended("from tests.mutants.__main__ import choose; print(choose(100, 7, 'wire'))")
    assert done.stdout.strip() == str(chosen), done.stderr
    assert len(set(chosen)) == 100
    assert {place.kind for place in chosen} >= {"comparison", "number", "call", "sign", "return"}
    assert not any("/simulated/" in place.path for place in choose(200, 7, "families"))


def test_the_nearest_tests_judge_first() -> None:
    stages = stages_of("lidario/families/ldrobot/decode.py")
    assert stages[:3] == [["tests/families/ldrobot/test_decode.py"], ["tests/families/ldrobot"], ["tests/families"]]
    assert ["tests/session"] in stages
    for stage in stages_of("lidario/session/talking/dialogue.py", whole=True):
        assert all((ROOT / path).exists() for path in stage)


def test_only_those_tests_judge_that_run_the_line(tmp_path: Path) -> None:
    module = tmp_path / "lidario" / "wire" / "one.py"
    module.parent.mkdir(parents=True)
    functions = "def f():\n    return (\n        2\n    )\n\n\ndef g():\n    return 3 + A\n"
    module.write_text(f"A = 1\nB = 1\n\n{functions}\n\nC = [lambda: 4]\n")
    near, far = "tests/wire/test_one.py::test_f[a b]", "tests/test_far.py::test_f"
    measured = CoverageData(basename=str(tmp_path / ".coverage"))
    runs = (("", [1, 2, 4, 10]), (f"{far}|run", [5]), (f"{near}|run", [5]), (f"{far}2|run", [11, 14]))
    for context, lines in runs:
        measured.set_context(context)
        measured.add_lines({str(module): lines})
    measured.write()

    covering = Covering(tmp_path / ".coverage", tmp_path)
    first, second, two, three, four = (
        Place("lidario/wire/one.py", line, 0, 1, "", "number") for line in (1, 2, 6, 11, 14)
    )

    assert [covering.is_run(place) for place in (two, three)] == [True, True]
    assert [covering.is_run(place) for place in (first, second, four)] == [False, False, False]
    assert covering.tests(two, ["tests/wire"]) == [[near], [far]]
    assert covering.tests(three, ["tests/wire"]) == [[f"{far}2"]]
    # Of a line that is run by the import: those that read what it defines, or else those that run anything.
    assert covering.tests(first, ["tests/wire"]) == [[f"{far}2"]]
    assert covering.tests(second, ["tests/wire"]) == [[near], [far, f"{far}2"]]
