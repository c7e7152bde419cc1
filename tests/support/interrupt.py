"""Ctrl-C at a chosen line, as the interpreter raises it: between any two lines of the main thread."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

__all__ = ["interrupted"]


def interrupted(line: int, function: Callable[[], object]) -> None:
    """Call `function`, and raise KeyboardInterrupt at the n-th line that is executed, if there are so many.

    Args:
        line: Which line, from 0 on; those of what is called are counted too.
        function: What to call.
    """
    left = line

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal left
        # Python ignores what is raised in the callback of a weak reference.
        if event == "line" and "_weakrefset" not in frame.f_code.co_filename:
            left -= 1
            if left < 0:
                sys.settrace(None)
                raise KeyboardInterrupt(f"{frame.f_code.co_qualname}:{frame.f_lineno}")
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        function()
    finally:
        sys.settrace(before)
