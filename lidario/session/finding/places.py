"""Where the device of a session may be found again, after the line to it was lost.

An address on the network stays the same, and so does a simulated device. A serial port may come back with another
name: the system numbers USB adapters in the order in which they appear, and gives the next number while a program
still holds the old one. So three kinds of ports are tried:

- where the device was last, and where the user said that it is: ``/dev/serial/by-id`` leads to it under any name;
- ports that were not there when the session was opened, or that have been away since. Only those whose adapter is
  one that lidars come with: a stray byte can reset other people's machines.

A port that was there all the time is never written to: it belongs to something else. A port at which another device
has responded, or nothing for a long time, is not asked again until it has been unplugged.
"""

import os
from dataclasses import replace
from typing import TypeAlias

from lidario.basics.source import Source
from lidario.basics.system import real_path, working_folder
from lidario.port.background import run_in_thread
from lidario.session.finding import discovery

MOST_IN_VAIN = 15
"""How often a port that nobody has named is asked in vain. That takes longer than a lidar boots (8 s)."""


_Port: TypeAlias = tuple[str, int | None]
"""A port, as the system has it at the moment: what to open, links followed, and its inode, None without one.
One that was unplugged and is back is another one."""


class Places:
    """The places of one device, whose source is neither ``auto`` nor ``id``."""

    def __init__(self, source: Source) -> None:
        if source.kind == "serial" and os.name == "posix":
            # A link with a relative path leads to it also when the program has gone to another folder.
            source = replace(source, address=str(working_folder() / source.address))
        self._named = source
        self.last: Source = source  # where it was last
        self._always: set[_Port] = set()
        self._in_vain: dict[_Port, int] = {}

    async def begin(self) -> None:
        """Note which ports there are. Cancelling ends only the waiting."""
        if self._named.kind == "serial":
            self._always = await run_in_thread(_ports)

    async def candidates(self) -> list[Source]:
        """Where to look now, the likeliest first. Cancelling ends only the waiting.

        Raises:
            ConnectFailed: The system allows no thread to look in.
        """
        own = [self.last] if self.last is self._named else [self.last, self._named]
        if self._named.kind != "serial":
            return own
        there = await run_in_thread(_ports)
        self._always &= there
        at: dict[_Port, Source] = {}
        for each in own:
            at.setdefault(_port(each.address), each)
        for port in sorted(there - self._always - set(at)):
            at[port] = Source(port[0], "serial", port[0])
        self._in_vain = {port: count for port, count in self._in_vain.items() if port in at}
        return [place for port, place in at.items() if self._in_vain.get(port, 0) < MOST_IN_VAIN]

    def is_own(self, place: Source) -> bool:
        """Whether it is where the user said that the device is, or where it was last."""
        return place in (self.last, self._named)

    def refuse(self, place: Source) -> None:
        """Another device is there. A network address is asked again: what is behind it cannot be seen."""
        if place.kind == "serial":
            self._in_vain[_port(place.address)] = MOST_IN_VAIN

    def silent(self, place: Source) -> None:
        """Nothing responds there: a port that nobody has named is not asked for ever."""
        if place.kind == "serial" and not self.is_own(place):
            port = _port(place.address)
            self._in_vain[port] = self._in_vain.get(port, 0) + 1


def _ports() -> set[_Port]:
    """Every serial port that may have a lidar; reads a few files of each."""
    return {_port(port.path) for port in discovery.list_serial_ports() if port.adapter}


def _port(path: str) -> _Port:
    real = real_path(path)
    try:
        return real, os.stat(real).st_ino
    except OSError:  # not there, or a system that has no file for a port
        return real, None
