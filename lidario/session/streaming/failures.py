"""What becomes of a stream, or of the session, when something has failed.

* A stream brings no scans: the device is asked (`Inquiry`). Then the stream is started again, or
  ends for every reader; the session goes on.
* A stream could not be started: the same.
* The port died: the session is over.

Where the session comes back by itself (`Reconnector`), and a new line may cure what has failed, none
of these ends anything: the line is let go of, and the readers wait.
"""

from __future__ import annotations

from collections.abc import Callable

from lidario.errors import (
    DeviceFault,
    DeviceLost,
    LidarError,
    RemoteProtocolError,
    ResponseTimeout,
    SessionClosed,
    StreamFailed,
)
from lidario.session.finding.connection import At
from lidario.session.streaming.control import StreamControl
from lidario.session.streaming.inquiry import Inquiry
from lidario.session.streaming.line_changes import LineWatch
from lidario.session.streaming.readers import Hub
from lidario.session.streaming.running import Failure
from lidario.session.streaming.states import State

_CURABLE = (DeviceLost, StreamFailed, ResponseTimeout, DeviceFault, RemoteProtocolError)
"""What a new line to the same device may cure; not what the user or lidario did wrong."""


class Failures:
    """Judges what has failed.

    Attributes:
        come_back: Called with the reason, and the number of scans so far, when the line to the device is no good
            any more. None where such an error ends the streams or the session.
    """

    def __init__(self, control: StreamControl, at: At, hub: Hub, inquiry: Inquiry, line: LineWatch) -> None:
        self.come_back: Callable[[LidarError, int], None] | None = None
        self._control = control
        self._at = at
        self._hub = hub
        self._inquiry = inquiry
        self._line = line
        at.dialogue.on_lost = self._lost

    def adopt(self) -> None:
        """The device is reached by another line from now on."""
        self._inquiry.doubtful = False
        self._at.dialogue.on_lost = self._lost
        self._line.tell("back")

    async def judge(self) -> None:
        """If a stream has failed, ask the device; then have the stream started again, or end it with the reason."""
        failure = self._control.failure
        if failure is None:
            return
        try:
            await self._control.interrupt()
            if failure.error is not None:
                # It may have begun all the same, and a device that scans hears no question.
                await self._at.dialogue.quieten()
            await self._inquiry.about(failure)
        except (StreamFailed, DeviceFault) as error:
            if failure.error is not None and isinstance(error, StreamFailed):
                self.could_not_start(failure.error)
            else:
                self._fail(error)
        else:
            self._control.leave_off()
            self._control.resume()
        finally:
            self._control.failure = None

    def suspect(self, failure: Failure) -> bool:
        """The stream brings no scans; whether the device is to be asked.

        Where noise arrives, no response would be understood: the stream ends.
        """
        if failure.noise:
            why = "; only noise arrives: is the baud rate right?"
            if counted := self._at.dialogue.errors.meaning():
                why = f"; only noise arrives, with {counted}"
            self._fail(StreamFailed(failure.what + why))
            return False
        self._control.failure = failure
        self._inquiry.doubtful = True
        return True

    def could_not_start(self, error: LidarError) -> None:
        """Tell everybody who waits for the stream, unless the session comes back."""
        if self._depart(error):
            return
        if self._control.ran:
            failure = StreamFailed(f"the stream could not be started again: {error}")
            failure.__cause__ = error
            error = failure
        self._hub.end(error)
        if self._control.is_scanning:
            self._control.unwant()

    def end(self, error: LidarError) -> None:
        """The session is over: end every reader and operation with `error`. The device is not told."""
        self._hub.end(error)
        self._control.close()
        self._at.dialogue.end(error)
        self._at.dialogue.interrupt(error)
        self._end_line(error)

    def _fail(self, error: StreamFailed | DeviceFault) -> None:
        """End the stream for everybody, unless the session comes back; the session goes on."""
        if self._depart(error):
            return
        self._at.trouble.tell("the stream ended: %s", error)
        self._hub.end(error)
        self._control.unwant()

    def _lost(self, error: LidarError) -> None:
        """The port died, or we failed: the session is over, unless it comes back."""
        if self._depart(error):
            return
        self._at.trouble.tell("the session ended: %s", error)
        self._hub.end(error)
        self._control.close()
        self._end_line(error)

    def _end_line(self, error: LidarError) -> None:
        if not isinstance(error, SessionClosed):
            self._line.tell("ended", str(error))
        self._line.end()

    def _depart(self, error: LidarError) -> bool:
        """Let go of the line, if the session can come back from `error`; readers go on waiting.

        False where it cannot: then `error` ends the streams, or the session.
        """
        if self._control.is_away:
            return True
        if self.come_back is None or self._control.state is State.CLOSED or not isinstance(error, _CURABLE):
            return False
        if not self._control.is_scanning and not isinstance(error, DeviceLost):
            return False
        self._control.lose(error)
        self._line.tell("away", str(error))
        self.come_back(error, self._control.totals.assembled.scans)
        return True
