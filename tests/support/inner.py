"""A run of pytest inside of a test, in this process, as a user's own run in a folder of his.

pytest's own `pytester` forgets afterwards every module that was first imported meanwhile. A later test would then
import lidario's modules a second time, beside the first ones. Here only the modules of the folder are forgotten.
"""

import contextlib
import io
import os
import sys
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import NamedTuple

import pytest

STRICT_INI = "[pytest]\nfilterwarnings = error\naddopts = --strict-markers\n"
ASYNCIO_INI = STRICT_INI + "asyncio_default_fixture_loop_scope = function\n"
"""Of a user who has pytest-asyncio."""
_INSTALLED = any(each.value == "lidario.testing.plugin" for each in entry_points(group="pytest11"))
"""An environment that was made before the plugin had an entry point is told to load it."""
_ALWAYS = (
    *(() if _INSTALLED else ("-p", "lidario.testing.plugin")),
    "-s", "-p", "no:cacheprovider", "-p", "no:cov", "-p", "no:xdist", "-p", "no:hypothesispytest",
    "-W", "ignore::pytest.PytestAssertRewriteWarning",
)  # fmt: skip


class Ran(NamedTuple):
    """What a run of pytest did."""

    outcomes: dict[str, int]  # how many tests passed, failed, ended with an error
    text: str  # what it printed
    code: int  # its exit code


class _Count:
    def __init__(self) -> None:
        self.outcomes: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            self.outcomes[report.outcome] += 1
        elif report.failed:
            self.outcomes["error"] += 1


@contextlib.contextmanager
def forgetting(folder: Path) -> Iterator[None]:
    """Be in `folder`, and forget behind the block which modules and paths of it were imported."""
    before, path = Path.cwd(), list(sys.path)
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        os.chdir(before)
        sys.path[:] = path
        for name, module in list(sys.modules.items()):
            if str(getattr(module, "__file__", None) or "").startswith(f"{folder}{os.sep}"):
                del sys.modules[name]


def run_pytest(folder: Path, *options: str) -> Ran:
    """Run pytest in `folder`."""
    count, said = _Count(), io.StringIO()
    with forgetting(folder), contextlib.redirect_stdout(said):
        code = pytest.main([*_ALWAYS, *options], plugins=[count])
    return Ran(dict(count.outcomes), said.getvalue(), int(code))
