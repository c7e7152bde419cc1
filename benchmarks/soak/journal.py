"""What happened in an hour of a soak: its last lines for people, and a digest of all of them."""

from __future__ import annotations

import hashlib

_KEPT, _TOLD = 50, 14


class Journal:
    """What happened, line by line.

    Attributes:
        lines: The last lines.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._digest = hashlib.sha256()

    def note(self, line: str) -> None:
        """Add a line."""
        self._digest.update(line.encode())
        self.lines.append(line)
        del self.lines[:-_KEPT]

    def told(self) -> str:
        """The last lines, as a paragraph."""
        return "\n".join(f"  {line}" for line in self.lines[-_TOLD:])

    @property
    def digest(self) -> str:
        """Of all lines; the same for the same seed."""
        return self._digest.hexdigest()[:16]
