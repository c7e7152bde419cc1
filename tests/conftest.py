"""How long tests run: short by default, long with ``--exhaustive``, ``--soak`` and ``HYPOTHESIS_PROFILE=search``.

- ``--exhaustive`` (each night and before a release): tests marked ``exhaustive`` go through all that they can, not
  through a sample; property tests try three times as many examples; and with the tests marked ``long``.
- ``--long`` (as in CI): these, too: real programs, browsers and routers, and all else of which a case takes a
  fifth of a second or more; and tests marked ``exhaustive`` with their whole sample, not a part of it. A test file
  that is named is run whole.
- ``--every-step``: two tasks at once are tried at every step of the event loop, not at every twelfth; five minutes.
- ``--soak SECONDS``: how long tests at true pace run.
- ``--rounds N``: how often tests at true pace act at a random moment; a few times by default, more with
  ``--exhaustive``.
- Hypothesis runs the same examples every time, so that no test fails by chance on one that nobody has seen;
  ``HYPOTHESIS_PROFILE=search`` searches for new ones, many of them.
"""

import gc
import importlib.util
import inspect
import logging
import os
import platform
import re
import shutil
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import just

from benchmarks.browser import find_browser
from tests.support.discards import all_obeyed, devices_made, may_discard, some_discarded
from tests.support.environment import obey_signals, search_alone, set_aside, start_fewer_threads
from tests.support.leaks import leaves_no_task, leaves_nothing
from tests.support.ledger import ledgers_made
from tests.support.samples import is_quick

FOLDER = Path(__file__).parent
PROPERTIES = FOLDER / "properties"
ORDER = pytest.StashKey[dict[Path, int]]()
"""Of the files and folders of the tests, in a worker that has begun to collect elsewhere."""
LONG = {"rounds", "soak"}
"""Fixtures of tests that take as long as they are told to."""
COVERED = [FOLDER / name for name in ("benchmarks", "families", "properties", "revolution", "session")]
"""Folders whose long tests run hardly a line that no quick test runs."""
FIRST = ("exhaustive", "long")
"""Markers of tests that are begun first."""
MEASURED = pytest.StashKey[bool]()
"""Of a case of a test: whether coverage is measured in it."""
NEVER_MIND = (HealthCheck.too_slow, HealthCheck.data_too_large)

settings.register_profile("ci", deadline=None, derandomize=True, max_examples=20, suppress_health_check=NEVER_MIND)
settings.register_profile("search", deadline=None, max_examples=1500, suppress_health_check=NEVER_MIND)
settings.register_profile("sample", settings.get_profile("ci"), max_examples=6)

NEEDS = {
    "test_page.py": "chromium",
    "test_page_masks.py": "chromium",
    "test_page_tools.py": "chromium",
    "test_completion_in_zsh.py": "zsh",
    "test_completion_in_fish.py": "fish",
    "test_tls.py": "openssl",
    "test_umockdev.py": "umockdev",
    "test_release.py": "git",
}
"""Test modules that are not run where a program is not installed; the summary says so."""
NEEDS_PACKAGE = {"test_example_dds.py": ("cyclonedds", "dds"), "test_example_rerun.py": ("rerun", "rerun")}
"""Likewise, where a package is not: one has no wheel for some machines, one is too large for everybody."""
NEEDS_PYTHON = {"test_eager_tasks.py": (3, 12)}
"""Likewise, where Python is too old: 3.11 has no tasks that begin at once."""
NEEDS_LINUX = re.compile(
    r"^\s*(import|from) (pty|tty|termios|fcntl|resource)\b|PtyServer|/proc/"
    r"|tests\.support\.(terminals|shells)\b|benchmarks\.soak\b|os\.fork\b"
    r"|import .*\b(served|opened_terminal|terminal_pair|paired|walked)\b|via=pty",
    re.MULTILINE,
)
"""Pseudo-terminals at any baud rate, terminals of shells, /proc: what only Linux has."""
NEEDS_POSIX = re.compile(r"os\.(kill|pipe|mkfifo)\b|\bline_of\b|\bsend_signal\b|\bSIGKILL\b|\bsymlink_to\b")
"""What Windows has in another way: signals to a process, pipes that `select` waits for, links."""


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Elsewhere, leave out the test modules that are about what this system does not have."""
    return True if _why_not_here(collection_path) else None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what was not run, and how it can be."""
    left_out: dict[str, list[str]] = {}
    for module in sorted(FOLDER.rglob("test_*.py")):
        if reason := _why_not_here(module):
            left_out.setdefault(reason, []).append(module.relative_to(FOLDER).as_posix())
    for reason, names in left_out.items():
        terminalreporter.write_line(f"not run: {', '.join(names)}: {reason}")


def _why_not_here(path: Path) -> str:
    """Why a test module is not run on this system; empty where it is."""
    module, extra = NEEDS_PACKAGE.get(path.name, ("", ""))
    if module and importlib.util.find_spec(module) is None:
        return f"no {module} is installed; .venv/bin/pip install -e '.[{extra}]'"
    if sys.version_info < (least := NEEDS_PYTHON.get(path.name, (3, 11))):
        return f"from Python {least[0]}.{least[1]} on"
    system = platform.system()
    needed = NEEDS.get(path.name)
    if system == "Linux":
        if needed is None or is_installed(needed):
            return ""
        return f"no {needed} is installed; sudo apt-get install {needed}"
    if not re.fullmatch(r"test_\w+\.py", path.name):
        return ""
    text = path.read_text(encoding="utf-8")
    if needed is not None or NEEDS_LINUX.search(text):
        return "about what only Linux has"
    return "about what Windows does not have" if system == "Windows" and NEEDS_POSIX.search(text) else ""


def is_installed(program: str) -> bool:
    """Whether tests can use the program; a browser may have one of several names, and umockdev has another one."""
    if program == "chromium":
        return find_browser() is not None
    return shutil.which("umockdev-run" if program == "umockdev" else program) is not None


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--soak", type=float, default=1.0, help="seconds that tests at true pace run")
    parser.addoption("--every-step", action="store_true", help="two tasks at once: at every step of the loop")
    parser.addoption("--rounds", type=int, default=0, help="random moments that tests at true pace act at")
    parser.addoption("--exhaustive", action="store_true", help="all tests, those marked exhaustive at full length")
    parser.addoption("--long", action="store_true", help="tests marked long, too")


def pytest_configure(config: pytest.Config) -> None:
    # Until `pytest_collection_finish`: what is collected stays, and the collector went through it again and again.
    gc.disable()
    set_aside()
    obey_signals()
    start_fewer_threads()
    search_alone()
    profile = "ci" if config.getoption("--exhaustive") else "sample"
    settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", profile))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give tests marked ``exhaustive`` their sample, a part of it in a quick run, or all that they can take."""
    full, long = metafunc.config.getoption("--exhaustive"), _runs_long(metafunc.config)
    for mark in metafunc.definition.iter_markers("exhaustive"):
        values = list(mark.kwargs["sample"])
        if full and "full" in mark.kwargs:
            values = list(mark.kwargs["full"])
        elif not long and len(values) > 3:
            values = [value for number, value in enumerate(values) if is_quick(number)]
        metafunc.parametrize(mark.args[0], values, ids=_named)


def _named(value: object) -> str:
    """What stands for a value of an exhaustive test in the test's name."""
    parts = value if isinstance(value, tuple) else (value,)
    return "-".join(str(getattr(part, "name", getattr(part, "__name__", part))) for part in parts)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Have each worker begin elsewhere: in a new clone all compiled the same files at the same time."""
    report = yield
    worker = getattr(collector.config, "workerinput", None)
    if worker and collector.path == FOLDER and isinstance(collector, pytest.Directory):
        found, number = report.result, int(worker["workerid"].removeprefix("gw"))
        collector.config.stash[ORDER] = {each.path: rank for rank, each in enumerate(found)}
        begin = number * len(found) // worker["workercount"]
        report.result = found[begin:] + found[:begin]
    return report


def pytest_pycollect_makeitem(
    collector: pytest.Module | pytest.Class, name: str, obj: object
) -> list[object] | None:
    """Make no cases of long tests that are left out."""
    marks = [
        *collector.iter_markers("long"),
        *(mark for mark in getattr(obj, "pytestmark", ()) if mark.name == "long"),
    ]
    return [] if marks and inspect.isfunction(obj) and not _runs_long(collector.config) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Have async tests watched by `leaves_no_task`, leave out the long ones, and sort by what takes longest."""
    if order := config.stash.get(ORDER, None):
        items.sort(
            key=lambda item: next((order[path] for path in (item.path, *item.path.parents) if path in order), 0)
        )
    if not _runs_long(config):
        left_out = [item for item in items if item.get_closest_marker("long")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("long")]
    # Which test runs a line, `tests.mutants` asks of each case.
    every_case = config.getoption("cov_context", None)
    seen = set[str]()
    for item in items:
        if isinstance(item, pytest.Function) and inspect.iscoroutinefunction(item.obj):
            item.obj = leaves_no_task(item.obj)
        test = item.nodeid.partition("[")[0]
        is_longer = any("full" in mark.kwargs for mark in item.iter_markers("exhaustive"))
        is_covered = bool(item.get_closest_marker("long")) and any(map(item.path.is_relative_to, COVERED))
        repeats = is_covered or PROPERTIES in item.path.parents or is_longer
        item.stash[MEASURED] = bool(every_case) or not (repeats or test in seen)
        seen.add(test)
    # The longest first: at the end, every worker still finds something to do.
    items.sort(key=lambda item: not (any(map(item.get_closest_marker, FIRST)) or LONG & set(_fixtures(item))))


def _runs_long(config: pytest.Config) -> bool:
    named = [Path(each.split("::")[0]) for each in config.invocation_params.args if isinstance(each, str)]
    return any(map(config.getoption, ("--exhaustive", "--long"))) or any(each.suffix == ".py" for each in named)


_tracers: list[object] = []


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Measure no coverage where other tests run the same lines: it makes tests up to three times as slow.

    What these tests alone reach counts as not covered. (pytest-cov's `no_cover` does nothing in xdist's workers.)
    """
    trace = sys.gettrace()
    assert trace is _tracers[-1], "an earlier test has left another tracer behind: nothing is measured any more"
    if item.stash[MEASURED] or not type(trace).__module__.startswith("coverage"):
        return (yield)
    sys.settrace(None)
    try:
        return (yield)
    finally:
        sys.settrace(trace)


def _fixtures(item: pytest.Item) -> list[str]:
    return item.fixturenames if isinstance(item, pytest.Function) else []


def pytest_collection_finish() -> None:
    """Thousands of tests and their modules live to the end: the garbage collector need not go through them.

    With its first example Hypothesis looks for what refers to its random generator, and on Python 3.14 it would not
    find that where it is frozen.
    """
    given(just(0))(lambda _: None)()
    _tracers.append(sys.gettrace())
    _freeze()
    gc.enable()


@pytest.fixture(scope="module")
def quick_collection() -> None:
    """For tests that call `gc.collect` often, which took 50 ms each: only what they make is searched."""
    _freeze()


def _freeze() -> None:
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _first_uvloop() -> None:
    """Libuv opens a pipe with the first loop of a process and keeps it: no test has left that behind."""
    if sys.platform != "win32":
        import uvloop

        uvloop.new_event_loop().close()


@pytest.fixture(autouse=True)
def _watched(request: pytest.FixtureRequest) -> Iterator[None]:
    """No test leaves a thread or a file descriptor behind, nor a log that is silent.

    No simulated device has discarded a request, unless the marker ``discards`` says why it may. Every byte and
    packet that a link or a session received is counted in exactly one place.
    """
    log = logging.getLogger("lidario")
    level, allowed = log.level, may_discard(request.node)
    with leaves_nothing():
        with devices_made() as devices, ledgers_made() as ledgers:
            yield
        ledgers.assert_closed()
        if not allowed:
            all_obeyed(devices)
        elif any(mark.name == "discards" for mark in request.node.own_markers):
            assert some_discarded(devices), "the marker discards is not needed: no request was discarded"
        # What only these hold is not left behind.
        del devices, ledgers
    assert log.level == level


@pytest.fixture
def soak(request: pytest.FixtureRequest) -> float:
    """Seconds that tests at true pace run."""
    return float(request.config.getoption("--soak"))


@pytest.fixture
def rounds(request: pytest.FixtureRequest) -> int:
    """At how many random moments a test at true pace acts."""
    usual = 8 if request.config.getoption("--exhaustive") else 4
    return int(request.config.getoption("--rounds")) or usual
