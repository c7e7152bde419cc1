"""Devices that only talk, of models that a table describes: what a family of such needs beside packets and decoder.

No packet of theirs tells the model; where models are to be read in different ways, a user names one. What a sample
takes is measured by the packets that are heard when the device is opened, or found in recorded bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Final, NamedTuple

from lidario.errors import ResponseTimeout, StreamFailed, Unsupported
from lidario.families.arguments import frequency_within
from lidario.families.base import (
    Decoder,
    Family,
    Known,
    NamedModel,
    RawStream,
    Script,
    Stream,
    Timing,
    raw_stream,
    told,
)
from lidario.families.unasked import LINKED, UnaskedDevice, begin, hear, hear_runs
from lidario.model import DeviceInfo, Health, HealthStatus, ScanMode
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat

__all__ = ["TIMING", "Rotor", "Speeds", "Talkers", "TalkingDevice", "TalkingModel"]

TIMING: Final = Timing(
    # A packet takes 17 ms at most, and a USB adapter may hold bytes back for 16 ms.
    quiet_s=0.06,
    drain_s=0.5,
    # It cannot be restarted from here.
    boot_s=3.0,
    boot_poll_s=0.25,
    # It hears nothing. One that has just been given power sends a second or two later.
    forget_s=3.0,
    probe_s=0.12,
)
"""Of those that nothing starts or stops."""
SPIN_UP_S: Final = 3.0
SETTLE_S: Final = 0.02
"""After a stop; no document demands it, and a packet takes less."""


class Speeds(NamedTuple):
    """How the motor of a model is regulated, where a request does that.

    Attributes:
        slowest: Revolutions a second.
        fastest: Likewise.
        step: What one unit of the request is, in revolutions a second.
        request: The request, by how many units.
    """

    slowest: float
    fastest: float
    step: float
    request: Callable[[int], Request]


@dataclass(frozen=True, slots=True)
class TalkingModel:
    """One model.

    Attributes:
        name: As in ``model=`` of a source.
        title: For people.
        baudrate: Speed of its line.
        sample_us: What a sample takes by its data sheet, microseconds.
        reach: Farthest distance in metres.
        wire: Makes the format of its packets.
        decoder: Makes their decoder.
        note: What else it may be, where its packets do not tell.
        start: What starts its motor and its stream; empty where it talks for as long as it has power.
        stop: What stops both; empty likewise.
        speeds: How the motor is regulated; None where it cannot be.
        slowest_turn_s: As in `Talkers`, where it is not that of the family; 0 where it is.
    """

    name: str
    title: str
    baudrate: int
    sample_us: float
    reach: float
    wire: Callable[[], StreamFormat]
    decoder: Callable[[], Decoder]
    note: str = ""
    start: bytes = b""
    stop: bytes = b""
    speeds: Speeds | None = None
    slowest_turn_s: float = 0.0


class Rotor(NamedTuple):
    """How devices whose motor the host powers tell that it does not turn as it should.

    Attributes:
        wire: Makes a format of all their packets, also of those that say so.
        rests_s: The longest time between two of those.
        trouble: What is to be told of one; empty for one that measures.
    """

    wire: Callable[[], StreamFormat]
    rests_s: float
    trouble: Callable[[bytes], str]


@dataclass(frozen=True, slots=True)
class Talkers:
    """The models of one family, and what tells more of them.

    Attributes:
        family: Short name of the family.
        models: Those that a user may name.
        unnamed: Which model it is, where no user has named one: by packets, of which most are in a row.
        sample_us: What a sample takes, by packets in a row; 0 where they do not tell.
        heard: Packets in a row from which both are known.
        hear_s: How long so many may take.
        slowest_turn_s: Longest time that one revolution may take: at the lowest speed, and half as long again.
        others: What else `unnamed` may return, where it is read in another way.
        wires: What makes the formats in which a device may talk, the likeliest first; none for that of any model.
        rotor: Where the host powers the motor.
        linked: Packets in a row that are no chance.
    """

    family: str
    models: Mapping[str, TalkingModel]
    unnamed: Callable[[bytes], TalkingModel]
    sample_us: Callable[[bytes], float]
    heard: int
    hear_s: float
    slowest_turn_s: float
    others: tuple[TalkingModel, ...] = ()
    wires: tuple[Callable[[], StreamFormat], ...] = ()
    rotor: Rotor | None = None
    linked: int = LINKED

    def row(self, title: str, simulated: tuple[str, ...], timing: Timing = TIMING) -> Family:
        """The family's row of the registry.

        Args:
            title: Name for people.
            simulated: Names of its simulated models.
            timing: How long its devices take.
        """
        return Family(
            name=self.family,
            title=title,
            baudrates=tuple(dict.fromkeys(model.baudrate for model in self.all)),
            timing=timing,
            device=self.device,
            stream_of=self.stream_of,
            formats=self.wires or tuple(dict.fromkeys(model.wire for model in self.all)),
            simulated=simulated,
            find_stream=self.find_stream,
            models=self.named,
            asked_at=tuple(dict.fromkeys(model.baudrate for model in self.all if model.start)),
        )

    def device(self) -> TalkingDevice:
        """A device whose model is not named."""
        return TalkingDevice(self)

    @property
    def named(self) -> dict[str, NamedModel]:
        """The models that may be named, for `Family.models`."""
        return {
            name: NamedModel(model.baudrate, partial(TalkingDevice, self, model))
            for name, model in self.models.items()
        }

    @property
    def all(self) -> tuple[TalkingModel, ...]:
        """All that is to be read in some way."""
        return (*self.models.values(), *self.others)

    def as_named(self, named: TalkingModel, packets: bytes) -> TalkingModel:
        """The model that the user has named, with a note where packets are those of another one."""
        seen = self.unnamed(packets)
        # Where a note stands they do not tell.
        if seen.note or seen.wire is named.wire:
            return named
        said = f"its packets are such as a {seen.title} sends, and are read as those of a {named.title}"
        return replace(named, note=f"{said}: leave out ?model={named.name}")

    def wires_of(self, named: TalkingModel | None) -> tuple[Callable[[], StreamFormat], ...]:
        """The formats in which to look for packets, where the user has named a model or not."""
        return (named.wire,) if named else self.wires or (self.all[0].wire,)

    def to_be_woken(self, named: TalkingModel | None) -> TalkingModel:
        """The model that may have been stopped, where none is heard and the user has named one or not."""
        return named or next((model for model in self.all if model.start), self.all[0])

    def find_stream(self, data: memoryview, known: Known) -> RawStream | None:
        """As `Family.find_stream`: at the first packets in a row, which may tell the model."""
        named = self.models[known.model] if known.model else None
        for made in self.wires_of(named):
            wire = made()
            for found in wire.header.finditer(data):
                at = found.start()
                rows = bytearray(data[at : at + (self.heard + 1) * wire.longest])
                run = wire.run(rows, 0)
                if sum(block.packets for block in run.packets) >= self.linked:
                    heard = bytes(rows[: run.end])
                    model = self.as_named(named, heard) if named else self.unnamed(heard)
                    sample_us = known.sample_us or self.sample_us(heard) or model.sample_us
                    return raw_stream(at, model.wire(), model.decoder(), sample_us, model.title, model.note)
        return None

    def stream_of(self, response_type: int) -> tuple[StreamFormat, Decoder] | None:
        """Format and decoder by the number that lidario gives each kind; None for another number."""
        made = ((model.wire(), model.decoder) for model in self.all)
        return next(((wire, decoder()) for wire, decoder in made if wire.response_type == response_type), None)


class TalkingDevice(UnaskedDevice):
    """One such device.

    Args:
        talkers: Its family.
        model: The model, where the user has named it.
    """

    def __init__(self, talkers: Talkers, model: TalkingModel | None = None) -> None:
        self._talkers = talkers
        self._named = model
        self.patience_s: float = talkers.hear_s
        if talkers.rotor is not None:
            self.rests_s: float = talkers.rotor.rests_s
        self._model = talkers.all[0]
        if model is not None:
            self._be(model)
        self._sample_us = self._model.sample_us
        self._units: int | None = None
        self._was_heard = False

    def _be(self, model: TalkingModel) -> None:
        """Be of this model. Before that it is not stopped."""
        self._model = model
        self.wake: bytes = model.start
        self.can_be_stopped: bool = bool(model.stop)
        if model.stop:
            self.can_keep_spinning: bool = False
        self.patience_s = SPIN_UP_S if model.start else self._talkers.hear_s

    def wire(self) -> StreamFormat:
        return self._model.wire()

    def stop(self) -> Request:
        if not self.can_be_stopped:
            return super().stop()
        return Request("STOP", self._model.stop, settle=SETTLE_S, ends_stream=True)

    def halt(self) -> tuple[Request, ...]:
        """As `Device.halt`: the motor stops with the stream, where it can be stopped."""
        return (self.stop(),)

    def complete_probe(self) -> bytes:
        """As `Device.complete_probe`: what has started it may have reached it though nothing came."""
        # Where most models need no start, one that has got it goes on: it is heard in the next round.
        return self._model.stop if all(model.start for model in self._talkers.all) else b""

    def identify(self) -> Script[DeviceInfo]:
        """As `Device.identify`: by its packets. One that may have been stopped is started for that."""
        runs = yield from self._hear()
        heard, of, self._was_heard = b"".join(runs), self._talkers, True
        self._be(of.as_named(self._named, heard) if self._named else of.unnamed(heard))
        # The median, for a run with damage that a check value does not find may tell anything.
        told_us = [each for each in map(self._talkers.sample_us, runs) if each]
        self._sample_us = median(told_us) if told_us else self._model.sample_us
        return DeviceInfo(self._talkers.family, self._model.title, 0, "", 0, "")

    def _hear(self) -> Script[tuple[bytes, ...]]:
        of = self._talkers
        wires = of.wires_of(self._named)
        # One that was heard before is what it was.
        woken = self._model if self._was_heard else of.to_be_woken(self._named)
        for number, wire in enumerate(wires):
            try:
                return (yield from hear_runs(wire, of.heard, of.hear_s, linked=of.linked))
            except ResponseTimeout:
                if number == len(wires) - 1 and not woken.start:
                    raise
        # What starts it may reach it though nothing comes back: from now on it must be stopped.
        self._be(woken)
        return (yield from hear_runs(wires[0], of.heard, SPIN_UP_S, woken.start, of.linked))

    def health(self) -> Script[Health]:
        """As `Device.health`: a warning where the rotor does not turn, a note where it may be another model."""
        trouble = yield from self._trouble()
        if trouble:
            return Health(HealthStatus.WARNING, 0, trouble)
        health = yield from super().health()
        return replace(health, note=self._model.note)

    def explain_silence(self, lasted_s: float) -> Script[bool]:
        """As `Device.explain_silence`.

        Raises:
            StreamFailed: The rotor does not turn as it should: no start would help.
        """
        trouble = yield from self._trouble()
        if trouble:
            raise StreamFailed(trouble)
        return (yield from super().explain_silence(lasted_s))

    def _trouble(self) -> Script[str]:
        rotor = self._talkers.rotor
        return "" if rotor is None else rotor.trouble((yield hear(rotor.wire(), 1, rotor.rests_s)))

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        """As `Device.modes`: there is one."""
        kind = self.wire().response_type
        return told((ScanMode(0, "Standard", self._sample_us, self._model.reach, kind, typical=True),))

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """As `Device.start`.

        Raises:
            Unsupported: A forced scan, or another device's mode.
        """
        wire = self.wire()
        if force or (mode.id, mode.response_type) != (0, wire.response_type):
            raise Unsupported("this device has one scan mode, 'Standard', and cannot be forced")
        yield begin(wire, self.wake)
        if self._model.speeds is not None and self._units is not None:
            yield self._model.speeds.request(self._units)
        return Stream(
            format=wire,
            decoder=self._model.decoder(),
            mode=mode,
            sample_ns=self._sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=self._model.slowest_turn_s or self._talkers.slowest_turn_s,
        )

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        speeds = self._model.speeds
        return super().scan_frequency_range() if speeds is None else told((speeds.slowest, speeds.fastest))

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`; each start sets it again, and it cannot be read back.

        Raises:
            Unsupported: No request does that.
            InvalidValue: Not a finite number, or outside of what the model can.
        """
        speeds = self._model.speeds
        if speeds is None:
            return super().set_scan_frequency(hertz)
        wanted = frequency_within(hertz, (speeds.slowest, speeds.fastest), self._model.title)
        return self._set_speed(speeds, round(wanted / speeds.step))

    def _set_speed(self, speeds: Speeds, units: int) -> Script[float]:
        yield speeds.request(units)
        self._units = units
        return units * speeds.step
