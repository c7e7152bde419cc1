"""Which requests are allowed: each is judged by its path, its Host, its Origin and its token, and by nothing else.

On the loopback interface every user of this machine may connect. There a browser is the danger: any page that it
shows may try to connect to this server. So the Host must be a name of this machine itself (a foreign name could be
pointed at it), and a WebSocket must come from our own page. Open to a network, a random token is asked for in
addition, and then the Host may be any name of this machine.
"""

from __future__ import annotations

import hmac
from typing import Final, Literal, NamedTuple
from urllib.parse import parse_qs, urlsplit

_LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")


class Refusal(NamedTuple):
    """Why a request is refused.

    Attributes:
        status: HTTP status.
        reason: One line for people.
    """

    status: int
    reason: str


def judge(token: str, path: str, hosts: list[str], origins: list[str]) -> Literal["page", "socket"] | Refusal:
    """Judge a request.

    Args:
        token: What everyone must know; empty on the loopback interface.
        path: What is asked for, with the query.
        hosts: The values of its Host header.
        origins: Those of its Origin header.
    """
    try:
        where, query = urlsplit(path).path, parse_qs(urlsplit(path).query)
        host = urlsplit(f"//{hosts[0]}").hostname if len(hosts) == 1 else None
    except ValueError:
        return Refusal(400, "that is no address")
    if host is None:
        return Refusal(400, "exactly one Host is needed")
    if not token and host not in _LOOPBACK:
        return Refusal(403, "this server is for this machine alone: open it as http://127.0.0.1")
    if token and not hmac.compare_digest(query.get("token", [""])[0].encode(), token.encode()):
        return Refusal(403, "the token is missing or wrong: open the address that lidario printed")
    if where == "/":
        return "page"
    if where != "/live":
        return Refusal(404, "there is only one page here: /")
    if origins not in ([f"http://{hosts[0]}"], [f"https://{hosts[0]}"]):
        return Refusal(403, "only this server's own page may connect")
    return "socket"
