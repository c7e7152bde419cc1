"""One Hokuyo lidar: what to ask in which order, and where its stream begins in recorded bytes.

``VV`` tells what it is, ``PP`` its field, ``II`` how it is. ``MD`` or ``ME`` begins to measure, ``QT`` ends it and
switches the laser off, ``RS`` sets all back. The motor turns as long as there is power, at a fixed speed.

A recorded stream begins with its first block. Where the bytes hold the response to ``PP``, it tells the field. Else
the first and the last step do: each kind of model has its own.
"""

import re
from typing import Final

from lidario.basics.model import DeviceInfo, Health, HealthStatus, SampleRate, ScanMode
from lidario.errors import RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Decoder, Device, Known, RawStream, Script, Stream, raw_stream
from lidario.families.hokuyo.commands import (
    ACCEPTED,
    FILL,
    QUESTIONS,
    RESET,
    STOP,
    ask,
    measure,
    read_lines,
    refusal,
    respond,
)
from lidario.families.hokuyo.decode import BlockDecoder
from lidario.families.hokuyo.formats import DistanceFormat, StrengthFormat, range_of
from lidario.families.hokuyo.geometry import Geometry, geometry_of
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor
from lidario.wire.formats import StreamFormat

FORMATS: Final = (DistanceFormat, StrengthFormat)
SPIN_UP_S: Final = 4.0
"""The rotor turns already; the laser is switched on by the request, and no document says how long that takes."""
PATIENCE_S: Final = 1.0
"""A damaged byte costs a whole scan of some thousand, so on a poor line dozens of them may be missing in turn."""
_DISTANCE_ALONE: Final = ("URG-04LX", "UBG-04LX", "UHG-08LX")
"""How the models begin that do not know ``ME``. One that is asked all the same may obey nothing until its power was
cut (ros-drivers/urg_c #4)."""
# "Sensor works well." (URG-04LX), "Stable 000 no error." (UTM-30LX), "sensor is working normally" (UST);
# "Trouble!! Error No. =[00->33]" (a UTM-30LX; jsk-ros-pkg/jsk_robot #873).
_WELL: Final = re.compile(r"\b(well|stable|normally|no error)\b", re.IGNORECASE)
_FAILED: Final = re.compile(r"\b(malfunction|failure|trouble|(?<!no )error)\b", re.IGNORECASE)
_CODE: Final = re.compile(r"\d{1,5}", re.ASCII)
_USUAL: Final = {
    (44, 725): ("URG-04LX", Geometry(44, 725, 384, 1024, 20, 5600, 600)),
    (0, 1080): ("UST-10LX, UST-20LX or UTM-30LX", Geometry(0, 1080, 540, 1440, 20, 60_000, 2400)),
}
_BLOCK: Final = re.compile(rb"(M[DE])\d{8}01\d{3}\n99b\n")
_FIELD: Final = re.compile(rb"PP\n(00P\n(?:[^\n]{1,80}\n){1,40})\n")


def mode_for(wire: type[DistanceFormat], geometry: Geometry) -> ScanMode:
    """The scan mode of a format."""
    return ScanMode(
        id=FORMATS.index(wire),
        name=wire.mode,
        sample_us=geometry.sample_us,
        max_distance=geometry.farthest / 1000,
        response_type=wire.response_type,
        typical=wire is DistanceFormat,
        details=geometry.text,
    )


class HokuyoDevice(Device):
    """One lidar that speaks SCIP 2.0."""

    motor_obeys = False
    fill: Request = FILL
    questions: tuple[Request, ...] = QUESTIONS

    def __init__(self) -> None:
        self._geometry: Geometry | None = None
        self._model = ""

    def stop(self) -> Request:
        # The laser goes off; the motor turns until the power is cut.
        return STOP

    def reset(self) -> Request:
        return RESET

    def respond(self, request: bytes, head: Descriptor, payload: bytes = b"") -> bytes:  # noqa: ARG002
        """As `Device.respond`, in lines of text."""
        return respond(request, payload or ACCEPTED)

    def identify(self) -> Script[DeviceInfo]:
        """As `Device.identify`; raises RemoteProtocolError where it tells a field that cannot be."""
        version = yield from ask("VV")
        field = yield from ask("PP")
        if geometry_of(field) is None:
            # Of damaged lines, one in 64 passes for a whole one.
            field = yield from ask("PP")
        self._geometry = geometry_of(field)
        if self._geometry is None:
            shown = ", ".join(f"{name}:{value}" for name, value in field.items())
            raise RemoteProtocolError(f"the device tells a field of view that cannot be: {shown[:200] or 'none'}")
        self._model = re.split(r"[\s(]", field.get("MODL", "") or version.get("PROD", ""), maxsplit=1)[0]
        return DeviceInfo(
            "hokuyo",
            f"Hokuyo {self._model}".rstrip(),
            0,
            re.split(r"[\s(]", version.get("FIRM", ""), maxsplit=1)[0],
            0,
            version.get("SERI", ""),
        )

    def health(self) -> Script[Health]:
        """As `Device.health`: in words; the note has them where they do not say that it is well."""
        state = (yield from ask("II")).get("STAT", "")
        has_failed = _FAILED.search(state) is not None
        if not has_failed and (not state or _WELL.search(state)):
            return Health(HealthStatus.OK, 0)
        code = int((_CODE.findall(state) or ["0"])[-1])
        return Health(HealthStatus.ERROR if has_failed else HealthStatus.WARNING, code, f"it says: {state}")

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        geometry = yield from self._field()
        known = FORMATS[:1] if self._model.startswith(_DISTANCE_ALONE) else FORMATS
        return tuple(mode_for(wire, geometry) for wire in known)

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """As `Device.start`; raises RemoteProtocolError where the device refuses."""
        geometry = yield from self._field()
        kind = next((each for each in FORMATS if mode_for(each, geometry) == mode), None)
        if force or kind is None:
            raise Unsupported("this device has the scan modes that it lists, and cannot be forced")
        wire = kind(geometry)
        request = measure(kind.word.decode(), geometry.first, geometry.last, wire)
        answered = yield request
        if answered != bytes((wire.response_type,)):
            refused = read_lines(answered)
            if not (yield from self.health()).ok:
                # As one that says nothing: the session asks what is wrong, and restarts it.
                raise ResponseTimeout(request.name, request.timeout)
            raise refusal(request.name, "" if refused is None else refused.status)
        return Stream(
            format=wire,
            decoder=BlockDecoder(kind, geometry),
            mode=mode,
            sample_ns=geometry.sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=max(PATIENCE_S, 90.0 / geometry.rpm),
        )

    def sample_rate(self) -> Script[SampleRate]:
        geometry = yield from self._field()
        return SampleRate(geometry.sample_us, geometry.sample_us)

    def scan_frequency(self) -> Script[float]:
        geometry = yield from self._field()
        return geometry.rpm / 60

    def _field(self) -> Script[Geometry]:
        if self._geometry is None:
            yield from self.identify()
        assert self._geometry is not None
        return self._geometry


def find_stream(data: memoryview, known: Known) -> RawStream | None:
    """The stream that begins with the first block; None without a block whose field is known."""
    found = _BLOCK.search(data)
    if found is None:
        return None
    begin, told = found.start(), _FIELD.search(data)
    lines = None if told is None else read_lines(told[1].rstrip(b"\n"))
    title, geometry = "", None if lines is None else geometry_of(lines.lines)
    if geometry is None:
        title, geometry = _USUAL.get(range_of(data, begin), ("", None))
    if geometry is None:
        return None
    kind = next(each for each in FORMATS if each.word == found[1])
    guess = "" if not title else f"taken for a {title}, by its first and last step: nothing else tells its field"
    return raw_stream(
        begin,
        kind(geometry),
        BlockDecoder(kind, geometry),
        known.sample_us or geometry.sample_us,
        title and f"Hokuyo {title}",
        guess,
        details=geometry.text,
    )


def stream_in(mode: ScanMode) -> tuple[StreamFormat, Decoder] | None:
    """As `Family.stream_in`: the mode tells the field, too."""
    kind = next((each for each in FORMATS if each.response_type == mode.response_type), None)
    told = (part.partition(":") for part in mode.details.split(";"))
    geometry = geometry_of({name: value for name, _, value in told})
    return None if kind is None or geometry is None else (kind(geometry), BlockDecoder(kind, geometry))
