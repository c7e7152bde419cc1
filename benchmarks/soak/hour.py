"""What is counted of one hour of a soak."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass(slots=True)
class Hour:
    """What one hour was.

    Attributes:
        steps: Steps done.
        did: How often each kind of step was done.
        errors: How often each error came, all on damaged lines or by the user's own doing.
        scans: Scans that readers got.
        sessions: Sessions opened.
        digest: Of everything that happened; the same for the same seed.
    """

    steps: int = 0
    did: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    scans: int = 0
    sessions: int = 0
    digest: str = ""
