"""How an adapter runs: it gets its task as JSON, and its result is the last line, whatever its driver does."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any


def respond(main: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Print what `main` makes of the task, or why it could not; then end the process."""
    stdout, sys.stdout = sys.stdout, sys.stderr  # some drivers talk
    try:
        result = main(json.loads(sys.argv[1]))
    except Exception as error:
        result = {"failed": f"{type(error).__name__}: {error}"}
    print(json.dumps(result), file=stdout, flush=True)
    os._exit(0)  # some drivers have threads that do not end
