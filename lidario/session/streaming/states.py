"""The states of a device's stream, and every way from one to another, in one table.

::

                  want                started
        IDLE ───────────> STARTING ───────────> RUNNING
         ^                 ^  │ ^                │  │
         │            want │  │ └── resume ──┐   │  │ interrupt
         │                 │  │              │   │  v
         └─── still ─── STOPPING <── unwant ─┴── INTERRUPTED

    unwant leads from STARTING, RUNNING and INTERRUPTED to STOPPING; close leads from everywhere to CLOSED.

                lose                   lose
        IDLE, STOPPING ──> AWAY       STARTING, RUNNING, INTERRUPTED ──> AWAITED
                            │  want: AWAY ──> AWAITED, unwant: AWAITED ──> AWAY    │
        IDLE <── return ────┘                           STARTING <── return ───────┘

* IDLE: no stream is wanted.
* STARTING: a stream is wanted and its start is under way, or waits until the device is free.
* RUNNING: packets flow, or will as soon as the rotor is up to speed.
* INTERRUPTED: a stream is wanted, but the device was stopped so that it can be asked something.
* AWAY: there is no line to the device until the session has found it again (`reconnect`); no stream is wanted.
* AWAITED: the same, and a stream is wanted.
* STOPPING: no stream is wanted any more; the stop requests are not written yet, or it was not seen yet that they
  were heard.
* CLOSED: the session is over.

`StreamControl` holds the state and asks this table for the next one. An event that the table does not know in a
state is a mistake in lidario, so it raises.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

__all__ = ["TRANSITIONS", "Event", "State"]


class State(Enum):
    """What becomes of the stream at the moment."""

    IDLE = "idle"
    STARTING = "starting"
    RUNNING = "running"
    INTERRUPTED = "interrupted"
    STOPPING = "stopping"
    AWAY = "away"
    AWAITED = "awaited"
    CLOSED = "closed"


class Event(Enum):
    """What happens to the stream."""

    WANT = "a reader wants scans"
    STARTED = "the device has announced its packets"
    INTERRUPT = "the device is asked something"
    RESUME = "the device was asked and is free again"
    UNWANT = "nobody wants scans any more"
    STILL = "the device is seen still"
    LOSE = "the line to the device is no good any more"
    RETURN = "there is a new line to the device"
    CLOSE = "the session ends"


_S, _E = State, Event

TRANSITIONS: Final[dict[State, dict[Event, State]]] = {
    _S.IDLE: {_E.WANT: _S.STARTING, _E.UNWANT: _S.STOPPING, _E.LOSE: _S.AWAY, _E.CLOSE: _S.CLOSED},
    _S.STARTING: {_E.STARTED: _S.RUNNING, _E.UNWANT: _S.STOPPING, _E.LOSE: _S.AWAITED, _E.CLOSE: _S.CLOSED},
    _S.RUNNING: {_E.INTERRUPT: _S.INTERRUPTED, _E.UNWANT: _S.STOPPING, _E.LOSE: _S.AWAITED, _E.CLOSE: _S.CLOSED},
    _S.INTERRUPTED: {_E.RESUME: _S.STARTING, _E.UNWANT: _S.STOPPING, _E.LOSE: _S.AWAITED, _E.CLOSE: _S.CLOSED},
    _S.STOPPING: {
        _E.STILL: _S.IDLE,
        _E.WANT: _S.STARTING,
        _E.UNWANT: _S.STOPPING,
        _E.LOSE: _S.AWAY,
        _E.CLOSE: _S.CLOSED,
    },
    _S.AWAY: {_E.WANT: _S.AWAITED, _E.UNWANT: _S.AWAY, _E.RETURN: _S.IDLE, _E.CLOSE: _S.CLOSED},
    _S.AWAITED: {_E.UNWANT: _S.AWAY, _E.RETURN: _S.STARTING, _E.CLOSE: _S.CLOSED},
    _S.CLOSED: {_E.CLOSE: _S.CLOSED},
}
"""State -> event -> next state. Whatever is not here cannot happen."""
