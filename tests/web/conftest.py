"""A browser, its tabs, and a page, for the tests that look at one."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from benchmarks.browser import Browser, Page
from tests.cli.processes import end, started
from tests.support.children import line_of
from tests.web.shown import S2, Open


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as opened:
        yield opened


@pytest.fixture
def opened(browser: Browser) -> Iterator[Open]:
    """Opens tabs; at the end of the test they are closed, and none has complained."""
    pages: list[Page] = []

    def open_page(url: str, **how: object) -> Page:
        pages.append(browser.open(url, **how))  # type: ignore[arg-type]
        return pages[-1]

    yield open_page
    for page in pages:
        page.close()
    assert [page.complaints for page in pages] == [[]] * len(pages)


@pytest.fixture
def viewed(opened: Open) -> Iterator[Open]:
    """Starts ``lidario view`` with some words, and opens its page; at the end it ends as by Ctrl-C."""
    with ExitStack() as stack:

        def view(*words: str) -> Page:
            process = stack.enter_context(started("view", *words, "--port", "0"))
            page = opened(re.sub("//[^:]+", "//127.0.0.1", line_of(process.stdout).strip()))
            stack.callback(end_both, process, page)
            return page

        yield view


def end_both(process: subprocess.Popen[str], page: Page) -> None:
    """What the browser says of a server that is gone is no complaint."""
    end(process)
    assert process.returncode == 0
    page.until("!connected")
    page.close()
    page.complaints.clear()


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """The page of one simulated lidar, for all tests that only look."""
    with started("view", S2, "--port", "0") as process:
        yield line_of(process.stdout).strip()
        end(process)
