"""Where the stream of one device stands, and every step from one `State` to the next.

`StreamControl` starts, interrupts and stops the stream, and holds at most one `Running`. It decides nothing: what
is wanted, and what a failure means, is decided by `Scanner`, `Starter` and `Failures`.
"""

import asyncio
import logging
import math
from collections.abc import Callable

from lidario.basics.model import ScanMode
from lidario.errors import DeviceLost, LidarError, ResponseTimeout, StreamFailed, Unsupported
from lidario.port.diagnose import is_pseudo_terminal
from lidario.revolution.assemble import AssemblerStats
from lidario.session.finding.connection import At
from lidario.session.streaming.modes import Wanted, does_not_fit
from lidario.session.streaming.readers import Hub
from lidario.session.streaming.running import Failure, Running, Totals
from lidario.session.streaming.states import TRANSITIONS, Event, State
from lidario.wire.states import LinkState

_log = logging.getLogger("lidario")

STOP_ATTEMPTS = 3
"""A damaged line may lose a STOP; three in a row mean that the device does not hear them."""


class NotWanted(LidarError):
    """Ends a start that nobody wants any more. No user sees it."""


class StreamControl:
    """The stream of one device."""

    def __init__(self, at: At, latency: float, hub: Hub, failed: Callable[[Failure], None]) -> None:
        self.totals: Totals = Totals(AssemblerStats())  # what was counted since the session was opened
        self.state: State = State.IDLE  # what becomes of the stream at the moment
        # The stream that ought to run, or the one that ran last and is wanted again.
        self.wanted: Wanted | None = None
        # Scan mode for readers that ask for none while none runs; None for the typical one.
        self.usual_mode: str | int | None = None
        self.modes: tuple[ScanMode, ...] = ()  # the scan modes of the device, once it was asked
        self.failure: Failure | None = None  # what is known of a stream that has failed, until the device was asked
        self.ran: bool = False  # whether a stream has run since one was wanted
        self.ran_until: float = -math.inf  # when the last stream was left off, seconds of the loop's clock
        # Whether the operation in progress is a start: it ends when no stream is wanted any more.
        self.starting: bool = False
        self._at = at
        self._latency = latency
        self._hub = hub
        self._failed = failed
        hub.on_parts = self._divide
        self._loop = asyncio.get_running_loop()
        self.running: Running | None = None  # the stream that runs, if one does

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs, or is about to."""
        return self.state in (State.STARTING, State.RUNNING, State.AWAITED)

    @property
    def is_away(self) -> bool:
        """Whether there is no line to the device, and the session is about to come back."""
        return self.state in (State.AWAY, State.AWAITED)

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs or is about to, if it is known."""
        return self.wanted.mode if self.wanted is not None and self.is_scanning else None

    def go(self, event: Event) -> None:
        """Take the one step that the table knows for `event`; raises KeyError where it knows none."""
        before, self.state = self.state, TRANSITIONS[self.state][event]
        if before is not self.state:
            _log.debug("%s: %s -> %s", event.value, before.value, self.state.value)

    def keep_modes(self, modes: tuple[ScanMode, ...]) -> None:
        """Take note of the scan modes that the device has told, and tell which it has not."""
        self.modes = modes
        if self._at.dialogue.device.modes_note:
            _log.warning("%s", self._at.dialogue.device.modes_note)

    # ------------------------------------------------------------------------------------------------ start, pause

    def want(self) -> None:
        """A reader wants scans: the stream is to be started, unless it is wanted already."""
        if self.state in (State.IDLE, State.AWAY):
            self.ran = False
            self.go(Event.WANT)

    async def start(self, wanted: Wanted) -> None:
        """Start the stream; where none begins, `failure` says so.

        Raises:
            Unsupported: It sends more than the line carries.
        """
        try:
            stream = await self._at.dialogue.run(self._at.dialogue.device.start(wanted.mode, force=wanted.force))
        except ResponseTimeout as error:
            # A device that has stopped to protect itself starts no stream, and does not say so by itself. Nor does
            # one that does not know the mode. A damaged line loses the request, or the response before the packets.
            lost = bool(error.noise) or wanted.mode in self.modes
            what, cause = f"no stream begins ({error})", "does it know this scan mode?"
            self.failure = Failure(what, cause, restart=lost, error=error)
            return
        if self.state is not State.STARTING or wanted != self.wanted:
            # Nobody wants it any more, and the stop requests are written already.
            return
        # Not before: the descriptor decides which format is sent, not what the list of modes foretold.
        misfit = does_not_fit(self._at.dialogue.device, self.modes, stream.mode, self._at.dialogue.port.baudrate)
        # A pseudo-terminal carries everything, whatever speed it was opened at.
        if misfit and not is_pseudo_terminal(self._at.dialogue.port.name):
            raise Unsupported(misfit)
        if stream.mode.id != wanted.mode.id:
            # It was not chosen here: the next stream of a recording, or another machine's lidar.
            self.wanted, self.modes = wanted._replace(mode=stream.mode), ()
        self.go(Event.STARTED)
        self.ran = True
        self.running = Running(stream, self._at, self._latency, self.totals, self._hub, self._failed)
        self.running.begin()

    def pause(self) -> None:
        """The stream that runs is not read any more; it is to be started again when the device is free."""
        self.totals.interruptions += 1
        self.go(Event.INTERRUPT)
        self.rest()

    async def interrupt(self) -> None:
        """Have the device hear the next question: stop its stream, not the motor, and wait for a quiet line."""
        if self.state is State.RUNNING:
            self.pause()
            await self.silence()
        elif self.failure is not None:
            # A start whose response was lost: it may scan all the same.
            await self._at.dialogue.quieten()

    async def silence(self) -> None:
        """Have the line quiet, by as many STOP requests as that takes."""
        if self._at.dialogue.link.state is LinkState.STREAMING or not await self._at.dialogue.quieten(stop=False):
            for _ in range(STOP_ATTEMPTS):
                if await self._at.dialogue.quieten():
                    return
            raise StreamFailed(
                f"bytes still arrive after {STOP_ATTEMPTS} STOP requests: the device does not hear them, or it is "
                "noise on the line. Check the cable and the plug"
            )

    def leave_off(self) -> None:
        """What passes until the stream goes on is counted as missed, as it is where the line was lost."""
        if self._hub.continued is not None:
            self.totals.assembled.leave_off(self._hub.continued)

    # ------------------------------------------------------------------------------------------------ stop

    def unwant(self) -> None:
        """Nobody wants the stream: stop the device as soon as it listens. Never blocks or raises."""
        if self.state is State.CLOSED:
            return
        self.go(Event.UNWANT)
        self.rest()
        self.wanted = self.failure = self._hub.continued = self.totals.assembled.left_off = None
        if self.starting:
            self._at.dialogue.interrupt(NotWanted("the stream is not wanted any more"))
        self._at.dialogue.stop_device()

    def rest(self) -> None:
        """The stream runs no more; the device is not told."""
        running, self.running = self.running, None
        if running is not None:
            self.ran_until = self._loop.time()
            running.end()

    def close(self) -> None:
        """The session is over; the device is not told."""
        self.rest()
        self.go(Event.CLOSE)

    # ------------------------------------------------------------------------------------------------ the line

    def lose(self, error: LidarError) -> None:
        """Let go of the line, which is no good any more because of `error`; a stream that is wanted stays so."""
        self.go(Event.LOSE)
        self.failure = None
        self.rest()
        self.leave_off()
        # Where the line still works, those who wait for a response must not wait for a device that is being left.
        lost = error if isinstance(error, DeviceLost) else DeviceLost(f"the line to the lidar is given up: {error}")
        if lost is not error:
            lost.__cause__ = error
        self._at.dialogue.fail(lost)

    def adopt(self) -> None:
        """There is a new line to the device: it is stopped, or a stream is to be started where one is wanted."""
        self.go(Event.RETURN)
        if not self.is_scanning:
            self._at.dialogue.stop_device()

    def _divide(self) -> None:
        if self.running is not None:
            self.running.divide()
