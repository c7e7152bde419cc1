"""Docstrings for the site: two colons at the end of a paragraph announce code."""

from __future__ import annotations

import re
from typing import Any

import griffe

__all__ = ["Plain"]

_ALONE = re.compile(r"^\s*::\n", re.MULTILINE)
_BEHIND = re.compile(r" ?::$", re.MULTILINE)


class Plain(griffe.Extension):
    """Takes the colons away."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring of one object."""
        if obj.docstring is not None:
            obj.docstring.value = _BEHIND.sub("", _ALONE.sub("", obj.docstring.value))
