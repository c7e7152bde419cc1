"""A zenoh router in this process, for machines on which no package brings one.

``eclipse-zenoh`` is the whole engine: a session in router mode that listens does what ``zenohd`` does without
plugins. It forwards between its clients, and stores nothing. It lets everybody in who reaches it, unless a
configuration says otherwise; so it listens to this machine alone unless it is told to.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Self

from lidario.arguments import path_of
from lidario.errors import ConnectFailed, InvalidValue
from lidario.network.bus import close_session
from lidario.network.router import check_router, the_package, words_of
from lidario.port.background import run_in_thread

LOOPBACK: Final = "tcp/127.0.0.1:7447"
"""Where it listens unless told otherwise; clients connect to ``tcp/localhost:7447`` by default."""


class Router:
    """A router; made by `Router.open`, and used as an asynchronous context manager.

    Attributes:
        addresses: Where it listens.
    """

    def __init__(self, session: Any, addresses: Sequence[str]) -> None:
        self._session = session
        self.addresses: tuple[str, ...] = tuple(addresses)

    @classmethod
    async def open(cls, *addresses: str, config: str | os.PathLike[str] | None = None) -> Router:
        """Listen, and forward what comes. Cancelling ends the waiting, and closes what still opens.

        Args:
            addresses: Where, in zenoh's notation; none: where the configuration says, or `LOOPBACK`.
            config: A file of zenoh's configuration in JSON5, for TLS and access control; None for that which
                ``ZENOH_CONFIG`` names, if any. Its mode is always that of a router.

        Raises:
            ConnectFailed: It cannot listen there: another program does (reason ``busy``), or such an address is not
                this machine's (``source``).
            InvalidValue: An address is none, or the file is no configuration.
            Unsupported: The package is not installed.
        """
        zenoh = the_package()
        for address in addresses:
            check_router(address)
        path = path_of(config, "a configuration") if config is not None else None
        made = _config(zenoh, path, addresses)
        where = json.loads(made.get_json("listen/endpoints"))
        found = where["router"] if isinstance(where, dict) else where
        try:
            session = await run_in_thread(lambda: zenoh.open(made), lambda session: session.close())
        except zenoh.ZError as error:
            raise _why_not(found, words_of(error)) from error
        return cls(session, found)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Let every connection break, within two seconds. Cancelling ends the waiting."""
        await close_session(self._session)


def _config(zenoh: Any, path: Path | None, addresses: Sequence[str]) -> Any:
    named = path or os.environ.get("ZENOH_CONFIG")
    try:
        config = zenoh.Config.from_file(str(named)) if named else zenoh.Config()
    except zenoh.ZError as error:
        raise InvalidValue(f"{named} is no configuration of zenoh: {words_of(error)}") from error
    settings: dict[str, Any] = {"mode": "router"}
    if addresses or not named:
        settings["listen/endpoints"] = list(addresses) or [LOOPBACK]
    if not named:
        # Only those who name its address: it looks for no other routers.
        settings |= {
            "scouting/multicast/enabled": False,
            "scouting/delay": 1,
            "transport/shared_memory/enabled": False,
        }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def _why_not(addresses: Sequence[str], text: str) -> ConnectFailed:
    where = ", ".join(addresses)
    if "in use" in text:
        return ConnectFailed(
            f"{where}: another program listens there already, perhaps a router: use that one, or another port, "
            "as in tcp/127.0.0.1:7448",
            reason="busy",
        )
    return ConnectFailed(f"no router can listen at {where}: {text}", reason="source")
