"""Families of devices that only talk: beside packets and decoder, such a family only needs a table of models.

No packet tells the model. If models are to be read in different ways, a user names one. The time of a sample is
measured by the packets that are heard when the device is opened, or found in recorded bytes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Any, Final, NamedTuple

from lidario.basics.model import DeviceInfo, Health, HealthStatus, ScanMode
from lidario.errors import ResponseTimeout, StreamFailed, Unsupported
from lidario.families.base import (
    Decoder,
    Device,
    Family,
    Known,
    NamedModel,
    RawStream,
    Script,
    Stream,
    Timing,
    raw_stream,
    runs_in,
)
from lidario.families.scripts import HEAR_S, LINKED, NOT_STOPPED, begin, frequency_within, hear, hear_runs, told
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor
from lidario.wire.formats import StreamFormat

TIMING: Final = Timing(
    # A packet takes 17 ms at most, and a USB adapter may hold bytes back for 16 ms.
    quiet_s=0.06,
    # Not used: such a device cannot be restarted from here.
    boot_s=3.0,
    # The device hears nothing. After power-on it begins to send within a second or two.
    forget_s=3.0,
)
"""For devices that nothing starts or stops."""
SPIN_UP_S: Final = 3.0
START_ATTEMPTS: Final = 2
"""A start request may be lost, and does no harm to a device that runs: ROBOTIS' driver sends it to those, too."""
SETTLE_S: Final = 0.02  # after a stop; no document demands it, and a packet takes less


class Speeds(NamedTuple):
    """How a request sets the speed of the motor."""

    limits: tuple[float, float]  # the slowest and the fastest speed, revolutions a second
    step: float  # one unit of the request, revolutions a second
    request: Callable[[int], Request]  # makes the request for so many units


@dataclass(frozen=True, slots=True)
class TalkingModel:
    """One model."""

    name: str  # as in ``model=`` of a source; empty if no user can name it
    title: str  # name for people
    baudrates: tuple[int, ...]  # speeds that its line may have, the likeliest first
    sample_us: float  # microseconds a sample, by its data sheet
    reach: float  # farthest distance in metres
    wire: type[StreamFormat]  # the format of its packets
    make_decoder: Callable[[Any], Decoder]  # makes their decoder, by the format
    note: str = ""  # which other model it may be, if packets do not tell
    start: bytes = b""  # bytes that start its motor and its stream; empty if it talks for as long as it has power
    stop: bytes = b""  # bytes that stop both; empty likewise
    speeds: Speeds | None = None  # how the speed of the motor is set; None if it cannot be
    # Longest time of one revolution: that at the lowest speed, and half as much more. Default: for 200 revolutions
    # a minute.
    slowest_turn_s: float = 0.45

    def decoder(self) -> Decoder:
        """A fresh decoder."""
        return self.make_decoder(self.wire)


class Rotor(NamedTuple):
    """How a device whose motor the host powers tells that the rotor does not turn as it should."""

    wire: Callable[[], StreamFormat]  # makes a format for all its packets, also for those that tell this
    rests_s: float  # the longest time between two packets that tell it
    trouble: Callable[[bytes], str]  # the message of a packet; empty for a packet of measurements


@dataclass(frozen=True, slots=True)
class Talkers:
    """The models of one family, and how to tell them apart."""

    family: str  # short name of the family
    all: tuple[TalkingModel, ...]  # all models that are known; a user may name those that have a name
    # Finds the model if no user has named one: by packets, of which some may be missing, and by the speed of the
    # line, as `Device.baudrate` has it.
    unnamed: Callable[[bytes, int | None], TalkingModel]
    heard: int  # how many packets that needs; they also give the time of a sample, if packets tell it
    # The formats in which to look for packets, the likeliest first; empty for the format of the first model.
    wires: tuple[type[StreamFormat], ...] = ()
    rotor: Rotor | None = None  # how the rotor is watched, if the host powers the motor

    @property
    def models(self) -> dict[str, TalkingModel]:
        """The models that a user may name, by their names."""
        return {model.name: model for model in self.all if model.name}

    def model_of(self, named: TalkingModel | None, packets: bytes, baudrate: int | None = None) -> TalkingModel:
        """The model that the user has named, with a note if packets are those of another; else the one found."""
        seen = self.unnamed(packets, baudrate)
        if named is None:
            return seen
        # With a note, packets do not tell the model.
        if seen.note or seen.wire is named.wire:
            return named
        said = f"its packets are such as a {seen.title} sends, and are read as those of a {named.title}"
        return replace(named, note=f"{said}: leave out ?model={named.name}")

    def wires_of(self, named: TalkingModel | None) -> tuple[type[StreamFormat], ...]:
        """The formats in which to look for packets; `named` is the model that the user has named, if any."""
        return (named.wire,) if named else self.wires or (self.all[0].wire,)

    def find_stream(self, data: memoryview, known: Known) -> RawStream | None:
        """As `Family.find_stream`: finds the first packets in a row, which may tell the model."""
        named = self.models[known.model] if known.model else None
        for made in self.wires_of(named):
            for at, run in runs_in(data, made(), self.heard + 1):
                count, heard = made().packets_in(run)
                # Two packets are needed even if one would be proof enough of the format: one tells no model.
                if count >= LINKED:
                    model = self.model_of(named, heard)
                    sample_us = known.sample_us or model.wire.sample_us(heard) or model.sample_us
                    return raw_stream(at, model.wire(), model.decoder(), sample_us, model.title, model.note)
        return None

    def stream_in(self, mode: ScanMode) -> tuple[StreamFormat, Decoder] | None:
        """As `Family.stream_in`: by the response type, a number that lidario gives each format."""
        found = (model for model in self.all if model.wire.response_type == mode.response_type)
        return next(((model.wire(), model.decoder()) for model in found), None)


class TalkingDevice(Device):
    """One device of a model that only talks; `model` is the one that the user has named, if any."""

    can_be_stopped: bool = False

    def __init__(self, talkers: Talkers, model: TalkingModel | None = None) -> None:
        self._talkers = talkers
        self._named = model
        # If nothing is heard, the device may be of this model and may have been stopped.
        self._woken = model or next((each for each in talkers.all if each.start), talkers.all[0])
        if talkers.rotor is not None:
            self.rests_s: float = talkers.rotor.rests_s
        self._model = talkers.all[0]
        if model is not None:
            self._be(model)
        self._sample_us = self._model.sample_us
        self._units: int | None = None
        self._was_heard = False

    def _be(self, model: TalkingModel) -> None:
        """Take on a model. Only a known model is stopped."""
        self._model = model
        self.can_be_stopped: bool = bool(model.stop)
        self.can_keep_spinning: bool = not model.stop
        self.speeds: tuple[float, float] | None = model.speeds.limits if model.speeds else None

    def stop(self) -> Request:
        if not self.can_be_stopped:
            return NOT_STOPPED
        return Request("STOP", self._model.stop, settle=SETTLE_S, ends_stream=True)

    def halt_unknown(self) -> tuple[Request, ...]:
        # A device that streams, but was not heard for long enough, may be of a model that can be stopped.
        is_known = self._was_heard or self.can_be_stopped or not self._woken.stop
        return () if is_known else (Request("STOP", self._woken.stop),)

    def respond(self, request: bytes, head: Descriptor, payload: bytes = b"") -> bytes:  # noqa: ARG002
        """As `Device.respond`, but without `head`: nothing announces its stream."""
        return payload

    def complete_probe(self) -> bytes:
        # The start request may have reached the device though nothing came. If some model needs no start, a device
        # that was started goes on, and is heard in the next round.
        return self._model.stop if all(model.start for model in self._talkers.all) else b""

    def end_search(self) -> bytes:
        return self._model.stop

    def identify(self) -> Script[DeviceInfo]:
        """As `Device.identify`: by its packets. A device that may have been stopped is started for that."""
        runs = yield from self._hear()
        self._was_heard = True
        self._be(self._talkers.model_of(self._named, b"".join(runs), self.baudrate))
        # The median: a run with damage that its check value does not show may tell any time.
        told_us = [each for each in map(self._model.wire.sample_us, runs) if each]
        self._sample_us = median(told_us) if told_us else self._model.sample_us
        return DeviceInfo(self._talkers.family, self._model.title, 0, "", 0, "")

    def _hear(self) -> Script[tuple[bytes, ...]]:
        of = self._talkers
        wires = of.wires_of(self._named)
        linked = 1 if wires[0].self_evident else LINKED
        # A device that was heard before keeps its model.
        woken = self._model if self._was_heard else self._woken
        for number, wire in enumerate(wires):
            try:
                return (yield from hear_runs(wire, of.heard, HEAR_S, linked=linked))
            except ResponseTimeout:
                if number == len(wires) - 1 and not woken.start:
                    raise
        # The start request may reach it though nothing comes back: from now on the device must be stopped.
        self._be(woken)
        # Once: while a device is opened, it is asked in rounds anyway.
        attempts = START_ATTEMPTS if self._was_heard else 1
        return (yield from hear_runs(wires[0], of.heard, SPIN_UP_S, woken.start, linked, attempts))

    def health(self) -> Script[Health]:
        """As `Device.health`: a warning if the rotor does not turn, a note if it may be another model."""
        trouble = yield from self._trouble()
        if trouble:
            return Health(HealthStatus.WARNING, 0, trouble)
        model = self._model
        patience_s, attempts = (SPIN_UP_S, START_ATTEMPTS) if model.start else (HEAR_S, 1)
        yield hear(model.wire(), LINKED, patience_s, model.start, attempts)
        return Health(HealthStatus.OK, 0, model.note)

    def explain_silence(self, lasted_s: float) -> Script[bool]:  # noqa: ARG002
        """As `Device.explain_silence`; raises StreamFailed if the rotor does not turn: no start would help."""
        trouble = yield from self._trouble()
        if trouble:
            raise StreamFailed(trouble)
        return False

    def _trouble(self) -> Script[str]:
        rotor = self._talkers.rotor
        return "" if rotor is None else rotor.trouble((yield hear(rotor.wire(), 1, rotor.rests_s)))

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        kind = self._model.wire.response_type
        return told((ScanMode(0, "Standard", self._sample_us, self._model.reach, kind, typical=True),))

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        model, wire = self._model, self._model.wire()
        if force or (mode.id, mode.response_type) != (0, wire.response_type):
            raise Unsupported("this device has one scan mode, 'Standard', and cannot be forced")
        yield begin(wire, model.start)
        if model.speeds is not None and self._units is not None:
            yield model.speeds.request(self._units)
        return Stream(
            format=wire,
            decoder=model.decoder(),
            mode=mode,
            sample_ns=self._sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=model.slowest_turn_s,
        )

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`; each start sets the frequency again, and it cannot be read back."""
        speeds = self._model.speeds
        if speeds is None:
            return (yield from super().set_scan_frequency(hertz))
        units = round(frequency_within(hertz, speeds.limits, self._model.title) / speeds.step)
        yield speeds.request(units)
        self._units = units
        return units * speeds.step


def family_of(talkers: Talkers, title: str, timing: Timing = TIMING) -> Family:
    """The row of the registry; `title` is the family's name for people."""
    named = {
        name: NamedModel(model.baudrates, partial(TalkingDevice, talkers, model))
        for name, model in talkers.models.items()
    }
    return Family(
        name=talkers.family,
        title=title,
        baudrates=tuple(dict.fromkeys(model.baudrates[0] for model in talkers.all)),
        timing=timing,
        device=partial(TalkingDevice, talkers),
        stream_in=talkers.stream_in,
        formats=talkers.wires_of(None),
        find_stream=talkers.find_stream,
        models=named,
        asked_at=tuple(dict.fromkeys(model.baudrates[0] for model in talkers.all if model.start)),
    )
