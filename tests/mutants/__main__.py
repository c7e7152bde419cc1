"""Which small changes the tests notice: ``python -m tests.mutants --count 200 --seed 7``, in a clone.

A place of the source is chosen by a seed and changed: a comparison turned, a number changed, a call left out.
Copies of the folder are changed, never the folder itself. The nearest tests judge first, up to the first that
fails. A test that fails is run once more without the change, and only counts where it passes then. Unless it is
told ``--unchecked``, it first runs all these tests without a change. ``--from 61`` goes on with change 61.
With ``--covered .coverage`` only those tests of the whole suite judge that run the changed line, which is faster
and misses less; `tests.mutants.covering` says how that file is made.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import chain
from pathlib import Path
from queue import SimpleQueue
from typing import Final, NamedTuple

import pytest

from tests.mutants.covering import Covering
from tests.mutants.places import Place, places_of

ROOT: Final = Path(__file__).resolve().parent.parent.parent
BESIDE: Final = ROOT.parent / "shared"
"""Some tests read what stands beside the project, where it does: recordings of real devices."""
PARTS: Final = ("wire", "families", "revolution", "session", "port")
_DEVICES: Final = re.compile(r"lidario/families/\w+/simulated[./]")
"""Simulated devices, a file or a folder in each family: the tests measure the driver by them."""
_ABOUT_TEXT: Final = (
    "architecture",
    "byte_order",
    "contributing",
    "docs",
    "docstrings",
    "layers",
    "loading",
    "mutants",
    "new_family",
    "package",
    "package_page",
    "public_api",
    "readme",
    "release",
    "security",
    "suite",
)
"""Test modules that look at the source itself, not at what it does."""
_ABOUT_TEXT_MODULES: Final = tuple(f"tests/test_{name}.py" for name in _ABOUT_TEXT)
_FEW: Final = 3
"""So few tests that run a line may not be all that depend on it."""
_NEAREST: Final = 2
"""Stages that judge then, too."""
_FIGURES: Final = "tests/test_golden.py"
"""What compares decoded figures with those of other decoders."""
_STAGE_S: Final = 1800.0
_TEST_S: Final = 60
_MOST_KB: Final = 8_000_000


class Verdict(NamedTuple):
    """What became of a change.

    Attributes:
        noticed: The test that failed, or why else the run ended; empty where no test noticed.
        took_s: Seconds.
    """

    noticed: str
    took_s: float


def choose(count: int, seed: int, only: str | None = None) -> list[Place]:
    """Places to change: the same ones for the same seed and source."""
    found: list[Place] = []
    for part in (only,) if only else PARTS:
        for path in sorted((ROOT / "lidario" / part).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not _DEVICES.match(name):
                found += places_of(name, path.read_bytes())
    return random.Random(seed).sample(found, min(count, len(found)))


def stages_of(name: str, whole: bool = False) -> list[list[str]]:
    """Which tests judge a change of this file, the nearest ones first."""
    parts = Path(name).parts
    folder = Path("tests", *parts[1:-1])
    while not (ROOT / folder).is_dir():
        folder = folder.parent
    near = sorted((ROOT / folder).rglob(f"test_{Path(name).stem}*.py"))
    stages = [[path.relative_to(ROOT).as_posix() for path in near]] if near else []
    wide = [folder.as_posix(), f"tests/{parts[1]}", "tests/wire", "tests/properties", _FIGURES]
    stages += [[path] for path in dict.fromkeys([*wide, "tests/revolution", "tests/session", "tests/port"])]
    return [*stages, ["tests"]] if whole else stages


def main(arguments: list[str] | None = None) -> int:
    """Try the changes; 1 with one that no test noticed, 2 where tests fail without a change."""
    options = _parser().parse_args(arguments)
    covering = None if options.covered is None else Covering(options.covered, ROOT)
    chosen = list(enumerate(choose(options.count, options.seed, options.only), 1))[options.start - 1 :]
    with tempfile.TemporaryDirectory(prefix="mutants ") as folder:
        if BESIDE.exists():
            Path(folder, BESIDE.name).symlink_to(BESIDE)
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(options.jobs):
            copies.put(_copied(Path(folder, str(number))))
        with ThreadPoolExecutor(options.jobs) as pool:
            if not options.unchecked:
                first = list(dict.fromkeys(tuple(stage) for _, place in chosen for stage in stages_of(place.path)))
                for why in pool.map(lambda stage: _with_copy(copies, list(stage)), first):
                    if why:
                        print(f"without any change: {why}", file=sys.stderr)
                        return 2

            def judge(numbered: tuple[int, Place]) -> Verdict:
                copy = copies.get()
                try:
                    verdict = _judge(copy, numbered[1], _stages(numbered[1], covering, options.whole))
                finally:
                    copies.put(copy)
                _tell(*numbered, verdict)
                return verdict

            verdicts = list(pool.map(judge, chosen))
    _sum_up([place for _, place in chosen], verdicts)
    return int(any(not verdict.noticed for verdict in verdicts))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description="which changes the tests notice")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--from", dest="start", type=int, default=1, help="the number of the first change")
    parser.add_argument("--whole", action="store_true", help="where no test notices, run all the others too")
    parser.add_argument("--covered", type=Path, help="a coverage database that knows which test runs which line")
    parser.add_argument("--unchecked", action="store_true", help="do not run the tests without a change first")
    return parser


def _copied(folder: Path) -> Path:
    return Path(shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__")))


def _with_copy(copies: SimpleQueue[Path], stage: list[str]) -> str:
    copy = copies.get()
    try:
        return _run(copy, stage)
    finally:
        copies.put(copy)


def _stages(place: Place, covering: Covering | None, whole: bool) -> list[list[str]]:
    stages = stages_of(place.path, whole)
    if covering is None:
        return stages
    found = covering.tests(place, list(chain.from_iterable(stages)))
    judging = [[test for test in tests if not test.startswith(_ABOUT_TEXT_MODULES)] for tests in found]
    judging = [tests for tests in judging if tests]
    if not judging:
        return stages
    if not covering.is_run(place):
        # Tests may compare what the import has made, and run nothing of the file.
        readers = covering.importing(place)
        return [*([readers] if readers else ()), *stages[:_NEAREST], *judging, [_FIGURES]]
    # Of very many that run a line only some are taken: those that are named like the file are not left out.
    named = [tests for tests in stages[:1] if tests[0].endswith(".py")]
    # Of what is made once and kept, only the test is known that was the first to need it.
    return [*named, *judging, *(stages[:_NEAREST] if sum(map(len, judging)) < _FEW else ())]


def _judge(copy: Path, place: Place, stages: list[list[str]]) -> Verdict:
    began = time.monotonic()
    path = copy / place.path
    for stage in stages:
        path.write_bytes(place.changed((ROOT / place.path).read_bytes()))
        try:
            why = _run(copy, stage)
        finally:
            shutil.copy2(ROOT / place.path, path)
        if why and (why.startswith("a hang") or not _run(copy, [why] if why.startswith("tests/") else stage)):
            return Verdict(why, time.monotonic() - began)
    return Verdict("", time.monotonic() - began)


def _run(copy: Path, tests: list[str]) -> str:
    """Run tests in a copy: the first that fails, or why else it ended; empty where all pass."""
    options = ["-x", "-q", "--long", "-p", "no:cacheprovider", "-o", f"faulthandler_timeout={_TEST_S}"]
    options += ["-o", "faulthandler_exit_on_timeout=true"]
    options += [f"--ignore={module}" for module in _ABOUT_TEXT_MODULES]
    with tempfile.TemporaryFile() as output, tempfile.NamedTemporaryFile("w", suffix=".txt") as named:
        named.write("\n".join(tests))
        named.flush()
        command = [sys.executable, "-m", "pytest", *options, f"@{named.name}"]
        process = subprocess.Popen(
            ["sh", "-c", f'ulimit -v {_MOST_KB}; exec "$@"', "sh", *command],
            cwd=copy,
            env={**os.environ, "PYTHONPATH": str(copy)},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = process.wait(_STAGE_S)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            _end(process)
        output.seek(0)
        text = output.read().decode(errors="replace")
    if code == 0:
        return ""
    if code == pytest.ExitCode.USAGE_ERROR and "ERROR: not found: " in text:
        # Parameters that the change alters have other names now.
        whole = list(dict.fromkeys(test.partition("[")[0] for test in tests))
        if whole == tests:
            raise RuntimeError(f"pytest did not run: {text.strip()[-1000:]}")
        return _run(copy, whole)
    failed = re.search(r"^(?:FAILED|ERROR) (tests/.*?)(?: - .*)?$", text, re.MULTILINE)
    if failed:
        return failed[1]
    if code is None or "Timeout (" in text:
        return f"a hang in {' '.join(tests[:3])}"
    return f"exit code {code} of {' '.join(tests[:3])}: {(text.strip().splitlines() or [''])[-1]}"


def _end(process: subprocess.Popen[bytes]) -> None:
    """End what the tests left behind too."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _tell(number: int, place: Place, verdict: Verdict) -> None:
    before, after = place.lines((ROOT / place.path).read_bytes())
    noticed = f"noticed by {verdict.noticed}" if verdict.noticed else "NOT NOTICED"
    print(
        f"{number}. {place.path}:{place.line} ({place.kind})\n- {before}\n+ {after}\n"
        f"  {noticed}, {verdict.took_s:.0f} s",
        flush=True,
    )


def _sum_up(places: list[Place], verdicts: list[Verdict]) -> None:
    for title, names in (
        ("part", [place.path.split("/")[1] for place in places]),
        ("kind", [place.kind for place in places]),
    ):
        print(f"\n{title:12}{'tried':>7}{'noticed':>9}")
        for row in _rows(names, verdicts):
            print(row)


def _rows(names: list[str], verdicts: list[Verdict]) -> Iterator[str]:
    tried = Counter(names)
    noticed = Counter(name for name, verdict in zip(names, verdicts, strict=True) if verdict.noticed)
    for name in sorted(tried):
        yield f"{name:12}{tried[name]:7}{noticed[name]:9}"
    yield f"{'all':12}{tried.total():7}{noticed.total():9}"


if __name__ == "__main__":
    sys.exit(main())
