"""A zenoh router in this process: no package brings zenohd, and a session in router mode is the same engine."""

from __future__ import annotations

import json
import socket
from typing import Any

import zenoh


class Router:
    """A router on a port of its own, that can go away and come back.

    Args:
        protocol: What is spoken at its port.
        config: Its configuration; where it listens is replaced.
    """

    def __init__(self, protocol: str = "tcp", config: str = "{}") -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"
        self._config = config
        self._session: Any = None
        self.start()

    def start(self) -> None:
        """Listen; connections of before come back by themselves."""
        config = zenoh.Config.from_json5(self._config)
        for name, value in {
            "mode": "router",
            "listen/endpoints": [self.address],
            "scouting/multicast/enabled": False,
            # It would wait half a second for other routers.
            "scouting/delay": 1,
            "transport/shared_memory/enabled": False,
        }.items():
            config.insert_json5(name, json.dumps(value))
        self._session = zenoh.open(config)

    def stop(self) -> None:
        """Let every connection break."""
        self._session.close()
