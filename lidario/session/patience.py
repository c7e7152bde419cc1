"""How long, and how often, a device is asked the same.

A request itself says how long its response may take and how often it is sent (`Request.timeout`,
`Request.attempts`). While it is not known which device is at the other end, and while a deadline holds for several
questions together, each is asked once, for a shorter time.
"""

from __future__ import annotations

import math

from lidario.wire.envelope import Request

__all__ = ["RESPONSE_S", "Patience"]

RESPONSE_S = 0.02
"""Time in which a healthy device has responded."""


class Patience:
    """Chooses attempts and timeout of each request."""

    def __init__(self) -> None:
        self._longest = self._until = math.inf

    def hurry(self, longest: float | None) -> None:
        """As `Dialogue.hurry`."""
        self._longest = math.inf if longest is None else longest

    def hurry_until(self, deadline: float | None) -> None:
        """As `Dialogue.hurry_until`."""
        self._until = math.inf if deadline is None else deadline

    def attempts(self, request: Request) -> int:
        """How often the request is sent where no response comes."""
        return 1 if min(self._longest, self._until) < math.inf else request.attempts

    def timeout(self, request: Request, now: float) -> float:
        """Seconds for which its response is waited for, from `now` on the loop's clock."""
        return min(request.timeout, self._longest, max(self._until - now, RESPONSE_S))
