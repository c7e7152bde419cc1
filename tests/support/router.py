"""A zenoh router in this process: no package brings zenohd, and a session in router mode is the same engine."""

import json
import socket
from typing import Any

import zenoh


def free_address(protocol: str = "tcp") -> str:
    """Where nobody listens, on this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


class Router:
    """A router on a port of its own, whatever its configuration says, that can go away and come back."""

    def __init__(self, protocol: str = "tcp", config: str = "{}") -> None:
        self.address = free_address(protocol)
        self._config = config
        self._session: Any = None
        self.start()

    def start(self) -> None:
        """Listen; connections of before come back by themselves."""
        self._session = _opened(
            self._config,
            {
                "mode": "router",
                "listen/endpoints": [self.address],
                # It would wait half a second for other routers.
                "scouting/delay": 1,
            },
        )

    def stop(self) -> None:
        """Let every connection break."""
        self._session.close()


def client(address: str) -> zenoh.Session:
    """A session of zenoh's with the router at `address`, for what a `Bus` does not do."""
    return _opened("{}", {"mode": "client", "connect/endpoints": [address]})


def _opened(config: str, more: dict[str, Any]) -> zenoh.Session:
    made = zenoh.Config.from_json5(config)
    always = {"scouting/multicast/enabled": False, "transport/shared_memory/enabled": False}
    for name, value in {**more, **always}.items():
        made.insert_json5(name, json.dumps(value))
    return zenoh.open(made)
