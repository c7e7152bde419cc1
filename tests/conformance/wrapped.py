"""Simulated devices on whose way in and out something is wrong."""

from __future__ import annotations

from typing import Any, Final

MS: Final = 1_000_000
OPENED: Final = 12
"""So many requests are made before the first rule is tried, or more."""
READS_MS: Final = (41, 67, 53, 189, 37, 73)
STOP, SCANS = b"\xa5\x25", (b"\xa5\x20", b"\xa5\x82")
MOTOR_OFF = b"\xa5\xa8\x02\0\0"


class Defective:
    """A simulated device on whose way in and out something is wrong."""

    def __init__(self, device: Any) -> None:
        self.device = device
        self.last_sent = self.last_stop = 0
        self.starts = self.questions = 0
        self.held: list[tuple[int, bytes]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)

    def receive(self, data: bytes, now: int) -> None:
        self.device.receive(data, now)

    def transmit(self, now: int) -> bytes:
        data: bytes = self.device.transmit(now)
        if data:
            self.last_sent = now
        return data

    def wakeup(self, now: int) -> int | None:
        at: int | None = self.device.wakeup(now)
        return at


class DeafAfterResponse(Defective):
    """It hears nothing for 50 ms behind what it has sent."""

    def receive(self, data: bytes, now: int) -> None:
        self.questions += 1
        if self.questions < OPENED or now - self.last_sent > 50 * MS or data[:2] == STOP:
            super().receive(data, now)


class DeafAfterStop(Defective):
    """It hears nothing for 40 ms behind STOP; the manual says 10."""

    def receive(self, data: bytes, now: int) -> None:
        if self.last_stop and now - self.last_stop < 40 * MS:
            return
        if data[:2] == STOP:
            self.last_stop = now
        super().receive(data, now)


class DeafAfterIdleStop(Defective):
    """STOP at rest keeps it from hearing for two seconds; one that ends a stream does not."""

    def receive(self, data: bytes, now: int) -> None:
        if self.last_stop and now - self.last_stop < 2000 * MS:
            return
        if data[:2] == STOP:
            self.last_stop = 0 if self.device.scanning or not self.starts else now
        elif data[:2] in SCANS:
            self.starts += 1
        super().receive(data, now)


class StopsLate(Defective):
    """It obeys STOP after 200 ms."""

    def receive(self, data: bytes, now: int) -> None:
        if data[:2] == STOP and self.device.scanning:
            self.held.append((now + 200 * MS, data))
        else:
            super().receive(data, now)

    def transmit(self, now: int) -> bytes:
        while self.held and self.held[0][0] <= now:
            at, data = self.held.pop(0)
            self.device.receive(data, at)
        return super().transmit(now)


class HeldBack(Defective):
    """What it sends arrives 50 ms later, as through a network or a busy computer; that is no defect of it."""

    def transmit(self, now: int) -> bytes:
        sent = super().transmit(now)
        if sent:
            self.held.append((now + 50 * MS, sent))
        data = b""
        while self.held and self.held[0][0] <= now:
            data += self.held.pop(0)[1]
        return data

    def wakeup(self, now: int) -> int | None:
        at = super().wakeup(now)
        ahead = self.held[0][0] if self.held else at
        return ahead if at is None or ahead is None else min(at, ahead)


class ReadLate(Defective):
    """What it sends is read late, and seldom, as by a computer that spares itself work; that is no defect of it."""

    next = reads = 0

    def transmit(self, now: int) -> bytes:
        if now < self.next:
            return b""
        self.reads += 1
        self.next = now + READS_MS[self.reads % len(READS_MS)] * MS
        return super().transmit(now)

    def wakeup(self, now: int) -> int | None:
        at = super().wakeup(now)
        return at if at is None else max(at, self.next)


class Chatters(Defective):
    """At rest it sends a byte every 100 ms, beginning a second after power-up."""

    next = 0

    def transmit(self, now: int) -> bytes:
        data = super().transmit(now)
        if not self.next:
            self.next = now + 400 * MS
        while self.next <= now:
            self.next += 100 * MS
            if not data and not self.device.scanning:
                data += b"\0"
        return data

    def wakeup(self, now: int) -> int | None:
        at = super().wakeup(now)
        ahead = self.next or now
        return ahead if at is None else min(at, ahead)


class StartsOnce(Defective):
    """It starts no stream that is asked for within 200 ms of the STOP before."""

    def receive(self, data: bytes, now: int) -> None:
        if data.startswith((STOP, MOTOR_OFF)) and self.device.scanning:
            self.last_stop = now
        if data[:2] in SCANS and self.last_stop and now - self.last_stop < 200 * MS:
            return
        super().receive(data, now)


class Damages(Defective):
    """Every 5000 bytes of a stream one is wrong."""

    sent = 0

    def transmit(self, now: int) -> bytes:
        data = bytearray(super().transmit(now))
        if self.device.scanning:
            before, self.sent = self.sent, self.sent + len(data)
            if self.sent // 5000 > before // 5000:
                data[len(data) // 2] ^= 0x5A
        return bytes(data)


class Skips(Defective):
    """For 150 ms of each second of a stream, from half a second on, nothing leaves it."""

    began = 0

    def transmit(self, now: int) -> bytes:
        data = super().transmit(now)
        self.began = (self.began or now) if self.device.scanning else 0
        return b"" if self.began and (now - self.began) % (1000 * MS) > 850 * MS else data
