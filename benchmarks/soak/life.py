"""An hour of one device and its users, drawn from a seed: each step does something, then everything is checked.

Sessions are opened, used in every way that the public names allow, and closed or let go. Meanwhile the line and the
device are damaged and mended (`benchmarks.soak.line`). From the moment of a damage until a session was opened again
after it was mended, every `LidarError` but `InternalError` is right. At all other times none is, but the few that a
user brings about himself: on a healthy device no response is late, no stream fails and no packet is lost.

Two things are demanded of a damaged device too: every call ends within `PATIENCE_S`, and what
`benchmarks.soak.watch` checks holds after every step.
"""

from __future__ import annotations

import asyncio
import gc
import random
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from typing import Any
from unittest.mock import patch

import lidario
from benchmarks.soak.calls import CALLS, SPEEDS
from benchmarks.soak.hour import Hour
from benchmarks.soak.journal import Journal
from benchmarks.soak.line import MODELS, BadLine, draw_damage
from benchmarks.soak.readers import Readers
from benchmarks.soak.watch import Broken, Watch
from tests.support.loop import DrivenLoop

__all__ = ["MODELS", "PATIENCE_S", "Life"]

PATIENCE_S = 90.0
"""In driven time; a call that takes longer hangs. The longest that is known is a list of modes that never comes."""

_COLLECT_EVERY = 25  # steps

_LONG_BLOCK_S = 0.5
"""A program that blocks its event loop for longer may lose a stream that protection guards, and responses."""

_LINGER_S = 10.0
"""How long timers and the task that starts streams may live when their session was let go: as long as a request."""

_NEXT_PROGRAM_S = 0.02
"""No program opens a port earlier than this after another one has closed it. A device has responded by then."""

_BY_THE_USER = (lidario.LocalProtocolError, lidario.InvalidValue, lidario.Unsupported, lidario.Busy)
"""Errors that a healthy device brings too: two tasks that want different things, what the model cannot do."""


class Life:
    """One hour.

    Args:
        family: Name of the family.
        seed: Decides all that happens.
        seconds: How long it lasts, in driven time.
        without: Words; a step whose name, or whose fault, contains one of them is not done.
    """

    def __init__(self, family: str, seed: int, seconds: float, without: Sequence[str] = ()) -> None:
        self.hour = Hour()
        self._journal = Journal()
        self._random = random.Random(f"{family} {seed}")
        self._seconds = seconds
        self._without = tuple(without)
        self._model = self._random.choice(MODELS[family])
        self._family = family
        self._seed = seed
        device: Any = lidario.simulate(
            self._model,
            world=self._random.choice(("room", "corridor", "circle")),
            spin_up=self._pick(0.0, 0.0, 1.5),
            seed=seed,
        )
        self._line = BadLine(device, self._pick(2, 10, 30) * 1_000_000)
        self._lidar: lidario.Lidar | None = None
        self._modes: tuple[str, ...] = ()
        self._readers = Readers(self.hour, self._failed)
        self._doubtful = False
        self._guarded = False  # protection may be on without the session's knowing
        self._alone: dict[str, Callable[[], Awaitable[None]]] = {
            "read": self._read,
            "leave": self._leave,
            "few": self._few,
            "wait": self._wait,
            "block": self._block,
            "stop": self._stop,
            "close": self._close,
            "let go": self._let_go,
        }

    async def run(self) -> Hour:
        """Live it.

        Raises:
            Broken: An invariant does not hold.
        """
        loop = asyncio.get_running_loop()
        assert isinstance(loop, DrivenLoop)
        self._loop = loop
        self._watch = Watch(self._line, loop)
        self._readers.own_tasks = self._watch.own_tasks
        end = loop.time() + self._seconds
        gc.disable()  # what is garbage is let go behind certain steps, so that a seed always means the same
        try:
            while loop.time() < end:
                await self._step()
            if self._line.fault:
                await self._checked("mend", self._mend)
            await self._checked("close", self._close)
            self._watch.collected()
        except AssertionError as error:
            if isinstance(error, Broken):
                raise
            raise self._broken(str(error)) from error
        finally:
            self._watch.close()
            await self._readers.end()
            if self._lidar is not None:
                await self._lidar.close()
            gc.enable()
        self.hour.digest = self._journal.digest
        return self.hour

    # ------------------------------------------------------------------------------------------------ steps

    async def _step(self) -> None:
        draw = self._random.random()
        if self._line.fault and draw < 0.25:
            await self._checked("mend", self._mend)
        elif not self._line.fault and draw < 0.06:
            await self._checked("damage", self._damage)
        elif self._lidar is None:
            await self._checked("open", self._open)
        elif draw < 0.55:
            name = self._pick(*self._alone)
            await self._checked(name, lambda: self._alone[name]())
        elif draw < 0.85:
            name = self._pick(*CALLS)
            await self._checked(name, lambda: self._call(name))
        elif draw < 0.95:
            name, delay = (
                self._pick(*CALLS),
                self._random.choice((0.0, 0.001, 0.02, 0.3, 2.0)) * self._random.random(),
            )
            await self._checked(f"cancel {name}", lambda: self._cancelled(name, delay))
        else:
            names = (self._pick(*CALLS), self._pick(*(name for name in CALLS if name not in SPEEDS)))
            await self._checked(f"{names[0]} beside {names[1]}", lambda: self._beside(*names))

    async def _checked(self, name: str, step: Callable[[], Awaitable[None]]) -> None:
        """Do one step, and check everything behind it."""
        if any(word in name for word in self._without):
            return
        self.hour.steps += 1
        self.hour.did[name.partition(" ")[0]] += 1
        self._note(f"{name}")
        limit = asyncio.timeout(PATIENCE_S)
        try:
            async with limit:
                self._watch.own_timer = limit.when()
                await step()
        except TimeoutError:
            if limit.expired():
                raise self._broken(f"hangs: not done after {PATIENCE_S:g} s") from None
            raise
        if not self.hour.steps % _COLLECT_EVERY:
            gc.collect()
        self._watch.complaints()
        self._watch.ledger(self._lidar)
        self._watch.requests(clean=not self._doubtful)
        self._watch.tasks(is_open=self._lidar is not None)
        if self._lidar is not None and not self._doubtful:
            self._watch.nothing_lost(self._lidar, guarded=self._guarded)

    def _broken(self, why: str) -> Broken:
        told = self._journal.told()
        return Broken(f"{why}\n  a {self._model}, step {self.hour.steps}; the last steps:\n{told}")

    # ------------------------------------------------------------------------------------------------ sessions

    async def _open(self) -> None:
        try:
            self._lidar = await lidario.open_lidar(
                self._line, family=self._family, latency=self._pick(0.0, 0.005, 0.05)
            )
        except lidario.LidarError as error:
            self._failed(error)
            await self._watch.closed(reachable=False)
            if not self._line.fault:
                raise self._broken(f"a healthy device was not opened: {error!r}") from error
            return
        self.hour.sessions += 1
        self._watch.opened(self._lidar)
        self._doubtful = bool(self._line.fault)
        self._guarded = self._line.protected
        if not self._modes and not self._doubtful:
            self._modes = tuple(mode.name for mode in await self._lidar.get_modes())

    async def _close(self) -> None:
        await self._readers.end()
        if self._lidar is not None:
            lidar, self._lidar = self._lidar, None
            await lidar.close()
            self._watch.ledger(lidar)
            self._watch.requests(clean=not self._doubtful)
        await self._watch.closed(reachable=not self._doubtful)
        await asyncio.sleep(_NEXT_PROGRAM_S)

    async def _let_go(self) -> None:
        """Forget the session without closing it, as a program with a mistake does."""
        await self._readers.end()
        # From Python 3.12 on, the event loop may still hold it the first time.
        for linger in (_LINGER_S, 0.0):
            # A finalizer waits without the loop until the device listens.
            with patch.object(time, "sleep", self._loop.block):
                self._lidar = None
                gc.collect()
            await asyncio.sleep(linger)
        await self._watch.closed(reachable=not self._doubtful)

    async def _stop(self) -> None:
        assert self._lidar is not None
        stopped = await self._tried(self._lidar.stop())
        if stopped and not self._doubtful:
            assert not self._line.scanning, "it scans behind stop()"
        if not self._doubtful:
            await self._readers.ended()

    # ------------------------------------------------------------------------------------------------ uses

    async def _read(self) -> None:
        """Have one more reader in the background."""
        assert self._lidar is not None
        if not self._readers.is_full:
            mode = self._pick(None, None, *self._modes) if not len(self._readers) else None
            stream = self._lidar.scans(mode, depth=self._pick(1, 3))
            await self._readers.begin(stream, slow=self._random.random() < 0.2)

    async def _leave(self) -> None:
        """One reader leaves."""
        await self._readers.leave(self._random.choice)

    async def _few(self) -> None:
        """Some scans, in a mode that the readers allow; left in order, or by a break."""
        assert self._lidar is not None
        count, tidy = self._random.randint(1, 12), self._random.random() < 0.7
        stream = self._lidar.scans(self._pick(None, *self._modes))
        with suppress(StopAsyncIteration):
            for _ in range(count):
                if not await self._tried(anext(stream)):
                    break
                self.hour.scans += 1
        if tidy:
            await self._tried(stream.aclose())

    async def _wait(self) -> None:
        await asyncio.sleep(self._random.choice((0.01, 0.3, 3.0, 20.0, 80.0)) * self._random.random())

    async def _block(self) -> None:
        """As a program that computes on its event loop."""
        seconds = self._random.choice((0.02, 0.2, 0.5, 2.0, 4.0)) * self._random.random()
        if seconds > _LONG_BLOCK_S:
            self._doubtful = True
        self._loop.block(seconds)
        await asyncio.sleep(0)

    # ------------------------------------------------------------------------------------------------ calls

    async def _call(self, name: str) -> None:
        assert self._lidar is not None
        await self._tried(CALLS[name](self._lidar, self._random))

    async def _cancelled(self, name: str, delay: float) -> None:
        """Call, and lose patience."""
        assert self._lidar is not None
        task = asyncio.ensure_future(self._tried(CALLS[name](self._lidar, self._random)))
        self._watch.own_tasks.add(task)
        await asyncio.sleep(delay)
        task.cancel()
        await asyncio.wait([task])
        self._guarded = self._guarded or (task.cancelled() and "protection" in name)
        self._watch.own_tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            raise error

    async def _beside(self, first: str, second: str) -> None:
        assert self._lidar is not None
        await asyncio.gather(
            self._tried(CALLS[first](self._lidar, self._random)),
            self._tried(CALLS[second](self._lidar, self._random)),
        )

    async def _tried(self, call: Awaitable[Any]) -> bool:
        """Await a call; False when it raised an error that was to be expected."""
        try:
            await call
        except lidario.LidarError as error:
            self._failed(error)
            return False
        return True

    def _failed(self, error: lidario.LidarError) -> None:
        name = type(error).__name__
        self.hour.errors[name] += 1
        self._note(f"  {name}: {error}")
        if isinstance(error, lidario.InternalError):
            raise self._broken(f"a mistake of ours: {error!r}, from {error.__cause__!r}") from error
        if not self._doubtful and not isinstance(error, _BY_THE_USER):
            raise self._broken(f"an error from a healthy device: {error!r}") from error
        if isinstance(error, lidario.DeviceLost | lidario.SessionClosed):
            self._doubtful = True

    # ------------------------------------------------------------------------------------------------ damage

    async def _damage(self) -> None:
        fault, seed = draw_damage(self._random), self._random.randrange(1 << 30)
        if any(word in fault for word in self._without):
            return
        self._note(f"  {fault}, seed {seed}")
        self._doubtful = True
        if self._random.random() < 0.3:
            self._line.device.faults_cleared_by_reset = False
        self._line.damage(fault, seed, round(self._loop.time() * 1e9))

    async def _mend(self) -> None:
        """The line is right again. As the session is, or with a new one, scans come."""
        self._line.device.faults_cleared_by_reset = True
        frozen = "freeze" in self._line.fault
        self._line.mend(round(self._loop.time() * 1e9))
        if self._lidar is None or self._random.random() < 0.6 or frozen:
            await self._close()
            await asyncio.sleep(self._random.choice((0.0, 0.5, 5.0)))
            await self._open()
            assert self._lidar is not None
            await self._lidar.scan()
            self._watch.ledger(self._lidar)

    # ------------------------------------------------------------------------------------------------ small things

    def _pick(self, *of: Any) -> Any:
        return self._random.choice(of)

    def _note(self, what: str) -> None:
        line = f"{self._loop.time():.6f} {what}"
        if self._lidar is not None:
            line += f" [{self._lidar.stats.bytes_received}]"
        self._journal.note(line)
