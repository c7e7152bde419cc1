"""One Hokuyo lidar: what to ask in which order.

``VV`` tells what it is, ``PP`` its field, ``II`` how it is. ``MD`` or ``ME`` begins to measure, ``QT`` ends it and
switches the laser off, ``RS`` sets all back. The motor turns as long as there is power, at a fixed speed.
"""

from __future__ import annotations

import re
from typing import Final

from lidario.errors import RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Device, Script, Stream
from lidario.families.hokuyo.commands import ACCEPTED, FILL, RESET, STOP, ask, measure, read_lines, refusal, respond
from lidario.families.hokuyo.decode import BlockDecoder
from lidario.families.hokuyo.formats import DistanceFormat, StrengthFormat
from lidario.families.hokuyo.geometry import Geometry, geometry_of
from lidario.families.scripts import told
from lidario.model import DeviceInfo, Health, HealthStatus, SampleRate, ScanMode
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor

FORMATS: Final = (DistanceFormat, StrengthFormat)
SPIN_UP_S: Final = 4.0
"""The rotor turns already; the laser is switched on by the request, and no document says how long that takes."""
PATIENCE_S: Final = 1.0
"""A damaged byte costs a whole scan of some thousand, so on a poor line dozens of them may be missing in turn."""
_NAMES: Final = {DistanceFormat: "Standard", StrengthFormat: "Intensity"}
_DISTANCE_ALONE: Final = "URG-04LX"
"""How the models begin that do not know ``ME``."""
_WELL: Final = re.compile(r"\b(well|stable|no error)\b", re.IGNORECASE)
_FAILED: Final = re.compile(r"\b(malfunction|failure)\b", re.IGNORECASE)
_CODE: Final = re.compile(r"\d{1,5}", re.ASCII)


def mode_for(wire: type[DistanceFormat], geometry: Geometry) -> ScanMode:
    """The scan mode of a format."""
    return ScanMode(
        id=FORMATS.index(wire),
        name=_NAMES[wire],
        sample_us=geometry.sample_us,
        max_distance=geometry.farthest / 1000,
        response_type=wire.response_type,
        typical=wire is DistanceFormat,
        details=geometry.text,
    )


class HokuyoDevice(Device):
    """One lidar that speaks SCIP 2.0."""

    can_keep_spinning = False
    fill: Request = FILL

    def __init__(self) -> None:
        self._geometry: Geometry | None = None
        self._model = ""

    def stop(self) -> Request:
        return STOP

    def halt(self) -> tuple[Request, ...]:
        # The laser goes off; the motor turns until the power is cut.
        return (STOP,)

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
        code = _CODE.search(state)
        if _FAILED.search(state):
            return Health(HealthStatus.ERROR, int(code[0]) if code else 0, f"it says: {state}")
        if not state or _WELL.search(state):
            return Health(HealthStatus.OK, 0)
        return Health(HealthStatus.WARNING, int(code[0]) if code else 0, f"it says: {state}")

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
        return (yield from told(self._geometry))
