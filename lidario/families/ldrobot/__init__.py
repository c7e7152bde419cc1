"""LDROBOT LD06, LD19, STL-06P, STL-19P, STL-26, STL-27L, LD08, LD14 and LD14P.

Sources throughout: the LD06 development manual v1.0, the vendor's SDKs, and a recording of a real LD06, from which
sample rate and unsteadiness are known. No request was tried on a real device.

The rate of the samples tells the models apart, for no packet tells model, firmware or serial number; while the
rotor does not turn, the clock in the packets tells it. Models of one rate are not told apart, but they measure
alike, except LD14 and LD08. Some LD14P have that rate too (more_families.md B1): the speed of their line tells
them. Sample rates: LD06 as measured on a real device, the others by data sheet.

The LD14P alone has requests, and may have been stopped: ``54 cmd 04 p0 p1 p2 p3 crc`` (codes: the vendor's SDK,
``ldlidar_protocol.h``, and a community port). Responses exist, but are not documented. So they are passed over as
records, and the stream tells whether a request was obeyed.
"""

from dataclasses import replace
from functools import partial
from typing import Final

from lidario.families.ldrobot.decode import AxisDecoder, TriangleDecoder
from lidario.families.ldrobot.formats import CRC, HEAD, AxisFormat, PacketFormat, TriangleFormat
from lidario.families.talking import SETTLE_S, TIMING, Speeds, Talkers, TalkingModel, family_of
from lidario.families.two_angles import TwoAngleDecoder
from lidario.wire.envelope import Request


def _encoded(command: int, parameter: int = 0) -> bytes:
    """The bytes of a request."""
    body = bytes((HEAD, command, 4)) + parameter.to_bytes(4, "little")
    return body + bytes((CRC.of(body),))


def _set_speed(degrees_per_second: int) -> Request:
    return Request("SET_SPEED", _encoded(0xA2, degrees_per_second), settle=SETTLE_S, in_stream=True)


def _model(name: str, title: str, baudrate: int, rate: float) -> TalkingModel:
    """One that turns five times a second at least."""
    of = name, f"LDROBOT {title}", (baudrate,), 1e6 / rate, 12.0, PacketFormat, TwoAngleDecoder
    return TalkingModel(*of, slowest_turn_s=0.3)


_lensed = partial(replace, reach=8.0, slowest_turn_s=0.75)
_axis = partial(_lensed, wire=AxisFormat, make_decoder=AxisDecoder)
_triangle = partial(_lensed, wire=TriangleFormat, make_decoder=TriangleDecoder)
"""Both triangulate; they turn twice a second at least."""

BEAM: Final = _model("ld06", "LD06", 230_400, 4546)  # time of flight
AXIS: Final = _axis(_model("ld08", "LD08", 115_200, 2300))
TRIANGLE: Final = _triangle(_model("ld14", "LD14", 115_200, 2300))
_LD14P: Final = replace(
    _triangle(_model("ld14p", "LD14P", 230_400, 4000)),
    start=_encoded(0xA0),
    stop=_encoded(0xA1),
    # The vendor's SDK: 720 to 2880 degrees a second.
    speeds=Speeds((2.0, 8.0), 1 / 360, _set_speed),
)
_STL27L: Final = replace(_model("stl-27l", "STL-27L", 921_600, 21_600), reach=25.0)
_LENS_UNKNOWN: Final = (
    "an LD14 and an LD08 send the same packets at the same rate. It is read as an LD14; the distances of an LD08 "
    "would be up to 60 mm short: name the model, as in ?model=ld08, or ?model=ld14"
)
_ALIKE: Final = replace(BEAM, name="", title="LDROBOT LD06, LD19 or alike")
_UNTOLD: Final = replace(
    _ALIKE,
    note="its rotor stands, and so does the clock in its packets: they do not tell the model. It is read as "
    "an LD06: name the model, as in ?model=ld14",
)
_BY_RATE: Final = (
    (10_000, _STL27L),
    (4250, _ALIKE),
    (3150, _LD14P),
    (0, replace(TRIANGLE, name="", title="LDROBOT LD14 or LD08", note=_LENS_UNKNOWN)),
)
"""The slowest rate of each kind."""


def _model_of(packets: bytes, baudrate: int | None) -> TalkingModel:
    rate = PacketFormat.samples_a_second(packets)
    if not rate and baudrate not in TRIANGLE.baudrates:
        return _UNTOLD
    model = next(model for slowest, model in _BY_RATE if rate >= slowest)
    return _LD14P if model.note and baudrate in _LD14P.baudrates else model


TALKERS: Final = Talkers(
    family="ldrobot",
    all=(
        BEAM,
        _model("ld19", "LD19", 230_400, 4500),
        _model("stl-06p", "STL-06P", 230_400, 5000),
        _model("stl-19p", "STL-19P", 230_400, 4500),
        _model("stl-26", "STL-26", 230_400, 5000),
        AXIS,
        TRIANGLE,
        _LD14P,
        _STL27L,
    ),
    unnamed=_model_of,
    # A revolution of an LD06: a real one is faster at some places of it than at others. By so many the rate is
    # known to 0.5 % (by a recording of one). Of an LD14 they take 0.2 s.
    heard=38,
)

FAMILY: Final = family_of(
    TALKERS,
    "LDROBOT",
    # Packets come every 5 ms at most. After power-up the first ones come within 0.7 s.
    replace(TIMING, quiet_s=0.05, forget_s=0.5),
)
