"""The task that brings the stream up: cancelling a reader, or a query, never ends other people's streams.

It runs while there is something to do: readers wait to be let in, a stream is to be started, or one has failed.
"""

import asyncio

from lidario.basics.arguments import shown
from lidario.errors import LidarError, LocalProtocolError, Unsupported
from lidario.port.background import begin_task
from lidario.session.finding.connection import At
from lidario.session.streaming.control import NotWanted, StreamControl
from lidario.session.streaming.failures import Failures
from lidario.session.streaming.modes import Wanted, choose_mode
from lidario.session.streaming.readers import Hub
from lidario.session.streaming.states import State
from lidario.session.talking.handshake import come_back


class Starter:
    """Lets readers in, and starts the stream they want."""

    def __init__(
        self,
        control: StreamControl,
        at: At,
        hub: Hub,
        failures: Failures,
        lock: asyncio.Lock,
    ) -> None:
        self._control = control
        self._at = at
        self._hub = hub
        self._failures = failures
        self._lock = lock
        self._loop = asyncio.get_running_loop()
        self._task: asyncio.Task[None] | None = None

    def work_soon(self) -> None:
        """Have done what is to be done, if there is anything."""
        # A coroutine that is collected after its loop was closed comes by here, too.
        if self._task is None and self._has_work and not self._loop.is_closed():
            self._task = begin_task(self._loop, self._work(), "lidario: start the stream")
            self._task.add_done_callback(self._ended)

    async def ended(self) -> None:
        """Return when the task has ended."""
        if self._task is not None:
            await asyncio.wait([self._task])

    @property
    def _has_work(self) -> bool:
        """Whether a stream is to be started; or, where there is a line, readers wait or a stream has failed."""
        control = self._control
        waits = self._hub.joining or control.failure is not None
        return control.state is State.STARTING or (bool(waits) and not control.is_away)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """Where the program has cancelled all tasks and goes on, no reader waits for ever."""
        if task.cancelled() and self._task in (None, task):
            self._task = None
            self._failures.could_not_start(
                LocalProtocolError("the program has cancelled the task that starts the stream")
            )

    async def _work(self) -> None:
        """Let the readers in who wait for it, and start the stream they want; until nothing is left to do."""
        control = self._control
        try:
            while self._has_work:
                async with self._lock:
                    # The line was lost, or the session closed, while another operation held it.
                    if control.is_away or control.state is State.CLOSED:
                        return
                    control.starting = True
                    try:
                        self._at.dialogue.begin()
                        if self._at.dialogue.reset_at is not None:
                            await come_back(self._at.dialogue)
                        await self._failures.judge()
                        await self._let_in()
                        if (wanted := control.wanted) is not None and control.state is State.STARTING:
                            await control.silence()
                            await self._failures.ask_beforehand()
                            await control.start(wanted)
                    except NotWanted:
                        continue
                    except LidarError as error:
                        self._failures.could_not_start(error)
                    finally:
                        control.starting = False
        except Exception as error:
            self._at.dialogue.mistaken(error, "when it started a stream")
        finally:
            self._task = None

    async def _let_in(self) -> None:
        """Let in the readers who wait, as far as the modes they ask for go together."""
        control, hub = self._control, self._hub
        while hub.joining:
            if not control.modes:
                await control.interrupt()
                control.keep_modes(await self._at.dialogue.run(self._at.dialogue.device.modes()))
                continue
            mailbox, mode, force = hub.joining.pop(0)
            try:
                wanted = self._agreed(mode, force)
            except (LocalProtocolError, Unsupported) as error:
                mailbox.end(error)
                continue
            hub.let_in(mailbox)
            if wanted != control.wanted:
                control.wanted = wanted
                await control.interrupt()
        if not hub.readers and control.is_scanning:
            control.unwant()

    def _agreed(self, mode: str | int | None, force: bool) -> Wanted:
        """The stream that a reader who asks for this and those who read already can share.

        Raises:
            Unsupported: The device has no such mode.
            LocalProtocolError: Another reader needs another mode.
        """
        control, running = self._control, self._control.wanted
        if running is not None and mode is None:
            return running
        modes = (*control.modes, *self._at.dialogue.device.unlisted_modes())
        usual = control.usual_mode
        try:
            wanted = Wanted(choose_mode(modes, usual if mode is None else mode), force)
        except Unsupported as error:
            if mode is None:
                raise Unsupported(f"mode = {shown(usual)} of the settings: {error}") from None
            raise
        if running is None or not self._hub.readers:
            return wanted
        if wanted.mode != running.mode:
            raise LocalProtocolError(
                f"scan mode {running.mode.name!r} is running for another stream: "
                f"leave that one before asking for {wanted.mode.name!r}"
            )
        return running
