"""An example as a process of its own, as its user runs it: what it opens, and its threads, end with it."""

import os
import subprocess
from contextlib import AbstractContextManager

from tests.support.children import ROOT, finished, started

EXAMPLES = ROOT / "examples"
PLACES = {"PYTHONPATH": os.pathsep.join([str(ROOT), str(EXAMPLES)]), "PYTHONWARNINGS": "default"}
"""What such a process needs. Packages of others may warn."""


def running(program: str, **more: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """Run this text as a program that may import examples; at the end of the block it is gone."""
    return started("-c", program, environment={**PLACES, **more}, stderr=None)


def run_example(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run an example to its end, as its user does."""
    return finished(str(EXAMPLES / f"{name}.py"), *arguments, environment=PLACES)
