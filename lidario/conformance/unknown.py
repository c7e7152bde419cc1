"""Every byte of a device that responds in no way known here, with the speed at which it was read.

These bytes are what support for it begins with. They are kept in memory until they are written, since a device that
responds is reported in another way.
"""

import asyncio
import json
from collections import defaultdict
from pathlib import Path
from typing import Final

from lidario.basics.model import DeviceInfo
from lidario.basics.source import as_source
from lidario.conformance.report import REPORT, facts_of_computer, texts_of_facts
from lidario.errors import ConnectFailed
from lidario.families.registry import FAMILIES
from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.recording.about import About
from lidario.recording.write import FileWriter
from lidario.version import __version__

LISTEN_S: Final = 1.0
OTHERS: Final = (9600, 19_200, 38_400, 57_600, 500_000, 1_500_000, 2_000_000)
"""Speeds of no family known here, at which other devices talk."""
MOST_BYTES: Final = 16 << 20  # of both directions; a line of 2,000,000 baud brings that in 80 s
SHOWN: Final = 48  # bytes of each speed that the page shows


class Unknown:
    """What came from a line on which nothing responds."""

    def __init__(self) -> None:
        self.received: int = 0
        self._size = 0
        self._port: Port | None = None
        self._offset_ns = 0
        self._entries: list[tuple[int, int, bool, bytes]] = []

    def attach(self, port: Port) -> None:
        """Keep every byte of that port from now on; a parameter ``on_port`` of those that open one."""
        self._port, self._offset_ns = port, port.wall_offset_ns
        port.add_tap(self._see)

    def forget(self) -> None:
        """A device has responded: keep no more, and nothing of what came."""
        if self._port is not None:
            self._port.remove_tap(self._see)
        self._entries.clear()

    async def kept(self, source: str, path: Path, facts: dict[str, str], *, overwrite: bool) -> bool:
        """Listen to a serial port at each speed, and write what came; False where nothing at all did."""
        where = as_source(source)
        if where.kind == "serial":
            await self._listen(where.address)
        if self.received:
            self._write(path, where.kind, facts, overwrite=overwrite)
        return bool(self.received)

    async def _listen(self, path: str) -> None:
        """Listen at each speed; at no more than one where nothing comes: a wrong speed is heard as garbage."""
        speeds = dict.fromkeys((*(speed for family in FAMILIES for speed in family.baudrates), *OTHERS))
        port = await open_serial(path, next(iter(speeds)))
        self.attach(port)
        try:
            for speed in speeds:
                before = self.received
                try:
                    port.set_baudrate(speed)
                except ConnectFailed:
                    continue  # the adapter cannot do it
                await asyncio.sleep(LISTEN_S)
                port.poll()
                if self.received == before:
                    break
        finally:
            await port.close()

    def _see(self, direction: str, data: bytes, now: int) -> None:
        if self._port is not None and self._size + len(data) <= MOST_BYTES:
            self._size += len(data)
            self.received += len(data) if direction == "in" else 0
            self._entries.append((now, self._port.baudrate, direction == "out", bytes(data)))

    def _write(self, path: Path, kind: str, facts: dict[str, str], *, overwrite: bool) -> None:
        began_ns = max(0, self._entries[0][0] + self._offset_ns)
        about = About(
            DeviceInfo("", "unknown", 0, "", 0, ""),
            source=kind,
            clock_offset_ns=self._offset_ns,
            lidario=__version__,
            began_ns=began_ns,
        )
        writer = FileWriter(path, about, overwrite=overwrite, sync=True)
        try:
            all_facts = {**facts_of_computer(), "line": kind, **facts, **self._by_speed()}
            writer.add_metadata(REPORT, {"format": "1", **texts_of_facts(all_facts)})
            before = 0
            for now, speed, sent, data in self._entries:
                at_ns = now + self._offset_ns
                if speed != before:
                    writer.add_event(at_ns, json.dumps({"event": "speed", "baudrate": speed}))
                    before = speed
                writer.add_chunk(at_ns, sent, data)
            writer.close()
        finally:
            writer.abandon()

    def _by_speed(self) -> dict[str, str]:
        """A fact for each speed: how much came, and how that ended: the first bytes may be of the speed before."""
        came = defaultdict[int, bytearray](bytearray)
        for _, speed, sent, data in self._entries:
            came[speed] += b"" if sent else data
        return {
            f"at {speed} baud" if speed else "received": f"{len(data)} bytes"
            + (f", the last ones {data[-SHOWN:].hex(' ')}" if data else "")
            for speed, data in came.items()
        }
