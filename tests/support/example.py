"""An example as a process of its own, as its user runs it: what it opens, and its threads, end with it."""

import os
import subprocess
import sys
from contextlib import AbstractContextManager

from tests.support.children import ROOT, gone_behind

EXAMPLES = ROOT / "examples"


def environment(**more: str) -> dict[str, str]:
    """The environment of such a process."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(EXAMPLES)]), **more}


def running(program: str, **more: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """Run this text as a program that may import examples; at the end of the block it is gone."""
    process = subprocess.Popen(
        [sys.executable, "-c", program], env=environment(**more), stdout=subprocess.PIPE, encoding="utf-8"
    )
    return gone_behind(process)


def run_example(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run an example to its end, as its user does."""
    return subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments],
        env=environment(), capture_output=True, encoding="utf-8", timeout=60,
    )  # fmt: skip
