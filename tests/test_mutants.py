"""The script that changes the source changes one line, which compiles, and the same ones for the same seed."""

from pathlib import Path

import pytest

from tests.mutants.__main__ import PARTS, ROOT, choose
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
    h(1e9)
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
            "h(2000000000.0)",
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


@pytest.mark.long
def test_simulated_devices_are_not_changed_and_lines_to_them_are() -> None:
    assert not any("simulated" in place.path for place in choose(10_000, 7, "families"))
    assert any(place.path == "lidario/port/simulated.py" for place in choose(10_000, 7, "port"))


def test_a_constant_is_judged_also_by_tests_that_only_read_it(tmp_path: Path) -> None:
    for name, text in {
        "lidario/a.py": "ONE = 1\nTWO = 2\n",
        "tests/test_one.py": "from lidario.a import ONE\n",
        "tests/deep/test_two.py": "from lidario.a import (\n    ONE as OTHER,\n    TWO,\n)\n",
        "tests/test_other.py": "from lidario.b import ONE, TWO\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    covering = Covering(tmp_path / ".coverage", tmp_path)
    places = [Place("lidario/a.py", line, 0, 0, "", "") for line in (1, 2)]
    both, one = map(covering.importing, places)
    assert (both, one) == (["tests/deep/test_two.py", "tests/test_one.py"], ["tests/deep/test_two.py"])
