"""One device that only talks, of a model that a table describes (`lidario.families.talking`), and its family's row.

No packet tells the model. What a sample takes is measured by the packets that are heard when the device is opened.
"""

from __future__ import annotations

from functools import partial
from statistics import median
from typing import Final

from lidario.errors import ResponseTimeout, StreamFailed, Unsupported
from lidario.families.base import Device, Family, NamedModel, Script, Stream, Timing, frequency_within, told
from lidario.families.talking import Speeds, Talkers, TalkingModel
from lidario.families.unasked import LINKED, NOT_STOPPED, begin, hear, hear_runs
from lidario.model import DeviceInfo, Health, HealthStatus, ScanMode
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor

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
HEAR_S: Final = 0.5
"""How long the packets by which a device is known may take."""
SPIN_UP_S: Final = 3.0
START_ATTEMPTS: Final = 2
"""What starts a device may be lost, and is harmless to one that runs: ROBOTIS' driver sends it to such, too."""
SETTLE_S: Final = 0.02
"""After a stop; no document demands it, and a packet takes less."""


class TalkingDevice(Device):
    """One device of a model that only talks; `model` is the one that the user has named, if any."""

    can_be_stopped: bool = False

    def __init__(self, talkers: Talkers, model: TalkingModel | None = None) -> None:
        self._talkers = talkers
        self._named = model
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
        self.can_be_stopped: bool = bool(model.stop)
        self.can_keep_spinning: bool = not model.stop

    def stop(self) -> Request:
        if not self.can_be_stopped:
            return NOT_STOPPED
        return Request("STOP", self._model.stop, settle=SETTLE_S, ends_stream=True)

    def halt(self) -> tuple[Request, ...]:
        # Where it can be stopped, the motor stops with the stream.
        return (self.stop(),)

    def halt_unknown(self) -> tuple[Request, ...]:
        # One that streams, and was not heard for long enough, may be of a model that can be stopped.
        if self._was_heard or self.can_be_stopped:
            return ()
        stop = self._talkers.to_be_woken(self._named).stop
        return (Request("STOP", stop),) if stop else ()

    def reset(self) -> Request:
        raise Unsupported("this device cannot be restarted from here: cut its power")

    def respond(self, request: bytes, head: Descriptor, payload: bytes = b"") -> bytes:  # noqa: ARG002
        """As `Device.respond`: nothing announces its stream."""
        return payload

    def complete_probe(self) -> bytes:
        # What has started it may have reached it though nothing came. Where most models need no start, one that has
        # got it goes on: it is heard in the next round.
        return self._model.stop if all(model.start for model in self._talkers.all) else b""

    def end_search(self) -> bytes:
        return self._model.stop

    def identify(self) -> Script[DeviceInfo]:
        """As `Device.identify`: by its packets. One that may have been stopped is started for that."""
        runs = yield from self._hear()
        self._was_heard = True
        self._be(self._talkers.model_of(self._named, b"".join(runs), self.baudrate))
        # The median, for a run with damage that a check value does not find may tell anything.
        told_us = [each for each in map(self._model.wire.sample_us, runs) if each]
        self._sample_us = median(told_us) if told_us else self._model.sample_us
        return DeviceInfo(self._talkers.family, self._model.title, 0, "", 0, "")

    def _hear(self) -> Script[tuple[bytes, ...]]:
        of = self._talkers
        wires = of.wires_of(self._named)
        linked = 1 if wires[0].self_evident else LINKED
        # One that was heard before is what it was.
        woken = self._model if self._was_heard else of.to_be_woken(self._named)
        for number, wire in enumerate(wires):
            try:
                return (yield from hear_runs(wire, of.heard, HEAR_S, linked=linked))
            except ResponseTimeout:
                if number == len(wires) - 1 and not woken.start:
                    raise
        # What starts it may reach it though nothing comes back: from now on it must be stopped.
        self._be(woken)
        # While it is opened it is asked in rounds.
        attempts = START_ATTEMPTS if self._was_heard else 1
        return (yield from hear_runs(wires[0], of.heard, SPIN_UP_S, woken.start, linked, attempts))

    def health(self) -> Script[Health]:
        """As `Device.health`: a warning where the rotor does not turn, a note where it may be another model."""
        trouble = yield from self._trouble()
        if trouble:
            return Health(HealthStatus.WARNING, 0, trouble)
        model, patience_s, attempts = self._model, HEAR_S, 1
        if model.start:
            patience_s, attempts = SPIN_UP_S, START_ATTEMPTS
        yield hear(model.wire(), LINKED, patience_s, model.start, attempts)
        return Health(HealthStatus.OK, 0, self._model.note)

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
        kind = self._model.wire().response_type
        return told((ScanMode(0, "Standard", self._sample_us, self._model.reach, kind, typical=True),))

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        wire = self._model.wire()
        if force or (mode.id, mode.response_type) != (0, wire.response_type):
            raise Unsupported("this device has one scan mode, 'Standard', and cannot be forced")
        yield begin(wire, self._model.start)
        if self._model.speeds is not None and self._units is not None:
            yield self._model.speeds.request(self._units)
        return Stream(
            format=wire,
            decoder=self._model.decoder(),
            mode=mode,
            sample_ns=self._sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=self._model.slowest_turn_s,
        )

    def scan_frequency_range(self) -> Script[tuple[float, float]]:
        speeds = self._model.speeds
        return super().scan_frequency_range() if speeds is None else told((speeds.slowest, speeds.fastest))

    def set_scan_frequency(self, hertz: float) -> Script[float]:
        """As `Device.set_scan_frequency`; each start sets it again, and it cannot be read back."""
        speeds = self._model.speeds
        if speeds is None:
            return super().set_scan_frequency(hertz)
        wanted = frequency_within(hertz, (speeds.slowest, speeds.fastest), self._model.title)
        return self._set_speed(speeds, round(wanted / speeds.step))

    def _set_speed(self, speeds: Speeds, units: int) -> Script[float]:
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
