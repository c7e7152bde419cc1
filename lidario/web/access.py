"""Which requests are allowed: each is judged by its path, its Host, its Origin and its token, and by nothing else.

On the loopback interface every user of this machine may connect. There a browser is the danger: any page that it
shows may try to connect to this server. So the Host must be a name of this machine itself (a foreign name could be
pointed at it), and a WebSocket must come from our own page. Open to a network, a random token is asked for in
addition, and then the Host may be any name of this machine.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from typing import Final, Literal
from urllib.parse import parse_qs, urlsplit

__all__ = ["AccessRules", "Refusal"]

_LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a request is refused.

    Attributes:
        status: HTTP status.
        reason: One line for people.
    """

    status: int
    reason: str


@dataclass(frozen=True, slots=True)
class AccessRules:
    """The rules of one server.

    Attributes:
        token: What everyone must know; empty on the loopback interface.
    """

    token: str = ""

    def check(self, path: str, hosts: list[str], origins: list[str]) -> Literal["page", "socket"] | Refusal:
        """Judge a request by its path with the query, and by the values of its Host and Origin headers."""
        try:
            where, query = urlsplit(path).path, parse_qs(urlsplit(path).query)
            host = urlsplit(f"//{hosts[0]}").hostname if len(hosts) == 1 else None
        except ValueError:
            return Refusal(400, "that is no address")
        if host is None:
            return Refusal(400, "exactly one Host is needed")
        if not self.token and host not in _LOOPBACK:
            return Refusal(403, "this server is for this machine alone: open it as http://localhost")
        if self.token and not hmac.compare_digest(query.get("token", [""])[0].encode(), self.token.encode()):
            return Refusal(403, "the token is missing or wrong: open the address that lidario printed")
        if where == "/":
            return "page"
        if where != "/live":
            return Refusal(404, "there is only one page here: /")
        if origins not in ([f"http://{hosts[0]}"], [f"https://{hosts[0]}"]):
            return Refusal(403, "only this server's own page may connect")
        return "socket"
