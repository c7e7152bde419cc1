"""Requests of the YDLIDAR 4ROS, with the response, the timeout and the settle time of each.

Codes and responses: 4ROS development manual, section 3 and figures 3, 4, 9, 11 and 13 to 15. Two requests are from
the vendor's SDK and not from the manual: FORCED_STOP (A5 00), which it sends before each STOP, and A5 92 for
health. The keepalive is SCAN again. While power-down protection is on, the manual demands it within 3 s of the last
one (3.8); the SDK repeats it every second.

Every request is two bytes, ``A5 cmd``, without payload and checksum. Six different responses share the type 04.
They are distinguished by their length, and those of equal length only because there is one request at a time.

A request that steps or toggles is sent once: sending it again would do it twice. Timeouts are those of the vendor's
SDK 1.2.20: 1 s for health and device information (health is asked in two ways, with half of it each), 2 s for the
rest. The documents demand no settle time. The SDK waits 5 ms (1.2.20) or 10 ms (1.2.19) after a stop; lidario waits
the longer of the two.
"""

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
"""The length in the scan header is to be ignored (manual 3.1), so every value of its 30 bits is accepted."""


def _setting(name: str, command: int, size: int, *, attempts: int = 1) -> Request:
    return Request(name, encode_request(command), Expected(SETTING, size), 2.0, attempts=attempts)


def _health(name: str, command: int) -> Request:
    return Request(name, encode_request(command), Expected(0x06, 3), 0.5, attempts=1)


ANNOUNCED: Final = Descriptor(0x81, 5, continuous=True)
"""The descriptor of every model's stream, whatever the length of its packets."""
STOP: Final = Request("STOP", encode_request(0x65), settle=STOP_SETTLE_S, ends_stream=True)
FORCED_STOP: Final = Request("FORCED_STOP", encode_request(0x00), settle=STOP_SETTLE_S, ends_stream=True)
RESET: Final = Request("RESET", encode_request(0x80), settle=STOP_SETTLE_S, ends_stream=True, boots=True)
"""Soft restart. No document says how long it takes: the host must ask afterwards until there is a response."""

GET_INFO: Final = Request("GET_INFO", encode_request(0x90), Expected(SETTING, 20), 1.0)
GET_HEALTH: Final = _health("GET_HEALTH", 0x91)
GET_HEALTH_92: Final = _health("GET_HEALTH (as A5 92)", 0x92)
QUESTIONS: Final = (GET_HEALTH, GET_HEALTH_92, GET_INFO)
COMPLETE_INFO: Final = bytes((0, 0xA5 ^ 0x90))
"""Two bytes that a 4ROS ignores, since no request begins with them. In the dialect where a request with bit 7 set
has a length and a checksum, they complete A5 90 to a request with an empty payload, which is refused."""
GET_ZERO_OFFSET: Final = _setting("GET_ZERO_OFFSET", 0x93, 4, attempts=2)

GET_SPEED: Final = _setting("GET_SPEED", 0x0D, 4, attempts=2)
STEPS: Final = {
    (False, True): _setting("SPEED_UP (by 0.1 Hz)", 0x09, 4),
    (False, False): _setting("SPEED_DOWN (by 0.1 Hz)", 0x0A, 4),
    (True, True): _setting("SPEED_UP (by 1 Hz)", 0x0B, 4),
    (True, False): _setting("SPEED_DOWN (by 1 Hz)", 0x0C, 4),
}
"""The requests for steps, by whether the step is coarse, and whether it leads up."""
FINE_STEP: Final = 10
COARSE_BEYOND: Final = 95
"""Hundredths of Hz: the small step, and the difference above which a step of 1 Hz is better (SDK)."""
MOST_STEPS: Final = 40
"""7 coarse and 9 fine steps lead from end to end of the range. More than twice as many, since the device may not
hear some."""

TOGGLE_PROTECTION: Final = _setting("TOGGLE_PROTECTION", 0xD9, 1)

DTR_TURNS: Final = Request("motor on by DTR", b"", settle=0.5, dtr=True)
"""The pause is that of the vendor's SDK (`startMotor`)."""
DTR_STOPS: Final = Request("motor off by DTR", b"", dtr=False)

KEEPALIVE: Final = Request("KEEPALIVE", encode_request(0x60), in_stream=True)


def scan(stream: StreamFormat) -> Request:
    """SCAN from standstill: a header, then packets without end."""
    announced = Expected(ANNOUNCED.type, 0, LARGEST, continuous=True)
    # Only the first SCAN has a header as its response (manual 3.8): while packets flow, it is not repeated.
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
            # The step may have been done: repeating the request could do it twice.
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
