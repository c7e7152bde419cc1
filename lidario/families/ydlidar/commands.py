"""Requests of the YDLIDAR 4ROS, with the response, the timeout and the settle time of each.

Codes and responses: 4ROS development manual, section 3 and figures 3, 4, 9, 11 and 13 to 15. Two requests are
not the manual's but the vendor SDK's: FORCED_STOP (A5 00), sent by it before each STOP, and A5 92 for health.
The keepalive is SCAN again: the manual wants it within 3 s of the last while power-down protection is on
(3.8), the SDK repeats it every second.

Every request is two bytes, ``A5 cmd``, without payload and checksum. Six different responses share the
type 04, so a response is told by its length, and those of equal length only by there being one request at a time.

A request that steps or toggles is sent once: sending it again would do it twice. Timeouts follow the patience of
vendor SDK 1.2.20: 1 s for health and device information (health is asked twice, in two ways, so half of it
each), 2 s for the rest. The documents demand no settle time; the SDK waits 5 ms (1.2.20) or 10 ms (1.2.19)
after a stop, and we the longer of the two.
"""

from __future__ import annotations

from typing import Final

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.families.scripts import agreed
from lidario.wire.envelope import Expected, Request, encode_request
from lidario.wire.events import Descriptor
from lidario.wire.formats import StreamFormat

STOP_SETTLE_S: Final = 0.010
SETTING: Final = 0x04  # the response type of all but health
LARGEST: Final = 0x3FFF_FFFF
"""The scan header's length is to be ignored (manual 3.1): every value is right that its 30 bits can hold."""


def _setting(name: str, command: int, size: int, *, attempts: int = 1) -> Request:
    return Request(name, encode_request(command), Expected(SETTING, size), 2.0, attempts=attempts)


def _health(name: str, command: int) -> Request:
    return Request(name, encode_request(command), Expected(0x06, 3), 0.5, attempts=1)


ANNOUNCED: Final = Descriptor(0x81, 5, continuous=True)
"""What announces the stream of every model, whatever the length of its packets."""
STOP: Final = Request("STOP", encode_request(0x65), settle=STOP_SETTLE_S, ends_stream=True)
FORCED_STOP: Final = Request("FORCED_STOP", encode_request(0x00), settle=STOP_SETTLE_S, ends_stream=True)
RESET: Final = Request("RESET", encode_request(0x80), settle=STOP_SETTLE_S, ends_stream=True)
"""Soft restart. How long it takes is in no document: after it the host must ask until there is a response."""

GET_INFO: Final = Request("GET_INFO", encode_request(0x90), Expected(SETTING, 20), 1.0)
GET_HEALTH: Final = _health("GET_HEALTH", 0x91)
GET_HEALTH_92: Final = _health("GET_HEALTH (as A5 92)", 0x92)
COMPLETE_INFO: Final = bytes((0, 0xA5 ^ 0x90))
"""Two bytes that no 4ROS reads, since no request begins so. In the dialect where a request with bit 7 set has a
length and a checksum, they make A5 90 a whole request with an empty payload, which is refused."""
GET_ZERO_OFFSET: Final = _setting("GET_ZERO_OFFSET", 0x93, 4, attempts=2)

GET_SPEED: Final = _setting("GET_SPEED", 0x0D, 4, attempts=2)
STEPS: Final = {
    (False, True): _setting("SPEED_UP (by 0.1 Hz)", 0x09, 4),
    (False, False): _setting("SPEED_DOWN (by 0.1 Hz)", 0x0A, 4),
    (True, True): _setting("SPEED_UP (by 1 Hz)", 0x0B, 4),
    (True, False): _setting("SPEED_DOWN (by 1 Hz)", 0x0C, 4),
}
"""By whether the step is a coarse one, and whether it leads up."""
FINE_STEP: Final = 10
COARSE_BEYOND: Final = 95
"""Hundredths of Hz: the small step, and the difference above which a step of 1 Hz is better (SDK)."""
MOST_STEPS: Final = 40
"""7 coarse and 9 fine steps lead from end to end of the range; twice that, since the device may not hear some."""

TOGGLE_PROTECTION: Final = _setting("TOGGLE_PROTECTION", 0xD9, 1)

DTR_TURNS: Final = Request("motor on by DTR", b"", settle=0.5, dtr=True)
"""The vendor's SDK waits as long (`startMotor`)."""
DTR_STOPS: Final = Request("motor off by DTR", b"", dtr=False)

KEEPALIVE: Final = Request("KEEPALIVE", encode_request(0x60), in_stream=True)


def scan(stream: StreamFormat) -> Request:
    """SCAN from standstill: a header, then packets without end."""
    announced = Expected(ANNOUNCED.type, 0, LARGEST, continuous=True)
    # Only the first SCAN has a header as its response (manual 3.8): once packets flow, asking again is in vain.
    return Request("SCAN", encode_request(0x60), announced, 2.0, attempts=1, stream=stream)


def step_to(wanted: int) -> Script[float]:
    """Step to a scan frequency in hundredths of Hz; returns what was reached, in Hz."""
    current = yield from ask_speed()
    for _ in range(MOST_STEPS):
        gap = wanted - current
        if abs(gap) <= FINE_STEP // 2:
            break
        coarse = abs(gap) > COARSE_BEYOND
        try:
            reached = _hundredths((yield STEPS[coarse, gap > 0]))
        except ResponseTimeout:
            # Done or not, asking for the step again might do it twice.
            reached = yield from ask_speed()
        else:
            if reached == current:
                break  # the device will not go further
        current = reached
    return (yield from ask_speed()) / 100


def ask_speed() -> Script[int]:
    """The scan frequency that is set, in hundredths of Hz."""
    return _hundredths((yield from agreed(GET_SPEED)))


def _hundredths(payload: bytes) -> int:
    return int.from_bytes(payload, "little")
