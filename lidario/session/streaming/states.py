"""The states of a device's stream, and every way from one to another, in one table.

`docs/architecture.md` says what each state means; a test compares its table with this one. `StreamControl` holds
the state and asks this table for the next one. An event that the table does not know in a state is a mistake in
lidario, so it raises.
"""

from enum import Enum
from typing import Final


class State(Enum):
    """What becomes of the stream at the moment."""

    IDLE = "idle"
    STARTING = "starting"
    RUNNING = "running"
    AWAY = "away"
    AWAITED = "awaited"
    CLOSED = "closed"


class Event(Enum):
    """What happens to the stream."""

    WANT = "a reader wants scans"
    STARTED = "the device has announced its packets"
    INTERRUPT = "the device is asked something"
    UNWANT = "nobody wants scans any more"
    LOSE = "the line to the device is no good any more"
    RETURN = "there is a new line to the device"
    CLOSE = "the session ends"


_S, _E = State, Event

TRANSITIONS: Final[dict[State, dict[Event, State]]] = {
    _S.IDLE: {_E.WANT: _S.STARTING, _E.UNWANT: _S.IDLE, _E.LOSE: _S.AWAY, _E.CLOSE: _S.CLOSED},
    _S.STARTING: {_E.STARTED: _S.RUNNING, _E.UNWANT: _S.IDLE, _E.LOSE: _S.AWAITED, _E.CLOSE: _S.CLOSED},
    _S.RUNNING: {_E.INTERRUPT: _S.STARTING, _E.UNWANT: _S.IDLE, _E.LOSE: _S.AWAITED, _E.CLOSE: _S.CLOSED},
    _S.AWAY: {_E.WANT: _S.AWAITED, _E.UNWANT: _S.AWAY, _E.RETURN: _S.IDLE, _E.CLOSE: _S.CLOSED},
    _S.AWAITED: {_E.UNWANT: _S.AWAY, _E.RETURN: _S.STARTING, _E.CLOSE: _S.CLOSED},
    _S.CLOSED: {_E.CLOSE: _S.CLOSED},
}
"""State -> event -> next state. Whatever is not here cannot happen."""
