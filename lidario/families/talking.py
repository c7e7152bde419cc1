"""Devices that only talk, of models that a table describes: what a family of such needs beside packets and decoder.

No packet of theirs tells the model; where models are to be read in different ways, a user names one. What a sample
takes is measured by the packets that are heard when the device is opened, or found in recorded bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from statistics import median
from typing import Final

from lidario.errors import Unsupported
from lidario.families.base import Decoder, Known, NamedModel, RawStream, Script, Stream, raw_stream, told
from lidario.families.unasked import LINKED, UnaskedDevice, begin, hear_runs
from lidario.model import DeviceInfo, Health, ScanMode
from lidario.wire.formats import StreamFormat

__all__ = ["Talkers", "TalkingDevice", "TalkingModel"]

SPIN_UP_S: Final = 3.0


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
    """

    name: str
    title: str
    baudrate: int
    sample_us: float
    reach: float
    wire: Callable[[], StreamFormat]
    decoder: Callable[[], Decoder]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Talkers:
    """The models of one family, and what tells more of them.

    Attributes:
        family: Short name of the family.
        models: By their names.
        unnamed: Which model it is, by packets in a row, where no user has named one.
        sample_us: What a sample takes, by packets in a row; 0 where they do not tell.
        heard: Packets in a row from which both are known.
        hear_s: How long so many may take.
        slowest_turn_s: Longest time that one revolution may take: at the lowest speed, and half as long again.
        make: Makes a device of this family, of the model that a user has named, if any.
    """

    family: str
    models: Mapping[str, TalkingModel]
    unnamed: Callable[[bytes], TalkingModel]
    sample_us: Callable[[bytes], float]
    heard: int
    hear_s: float
    slowest_turn_s: float
    make: Callable[[Talkers, TalkingModel | None], TalkingDevice] = field(
        default_factory=lambda: TalkingDevice, repr=False
    )

    def device(self) -> TalkingDevice:
        """As `Family.device`."""
        return self.make(self, None)

    @property
    def named(self) -> dict[str, NamedModel]:
        """As `Family.models`."""
        return {
            name: NamedModel(model.baudrate, partial(self.make, self, model)) for name, model in self.models.items()
        }

    @property
    def any(self) -> TalkingModel:
        """Any of them: the first one."""
        return next(iter(self.models.values()))

    def find_stream(self, data: memoryview, known: Known) -> RawStream | None:
        """As `Family.find_stream`: at the first packets in a row, which may tell the model."""
        wire = (self.models[known.model] if known.model else self.any).wire()
        for found in wire.header.finditer(data):
            at = found.start()
            rows = bytearray(data[at : at + self.heard * wire.longest])
            run = wire.run(rows, 0)
            if sum(block.packets for block in run.packets) >= LINKED:
                heard = bytes(rows[: run.end])
                model = self.models[known.model] if known.model else self.unnamed(heard)
                sample_us = known.sample_us or self.sample_us(heard) or model.sample_us
                return raw_stream(at, model.wire(), model.decoder(), sample_us, model.title, model.note)
        return None

    def stream_of(self, response_type: int) -> tuple[StreamFormat, Decoder] | None:
        """As `Family.stream_of`."""
        made = ((model.wire(), model.decoder) for model in self.models.values())
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
        self._model = model or talkers.any
        self._sample_us = self._model.sample_us
        self.patience_s: float = talkers.hear_s

    def wire(self) -> StreamFormat:
        """As `UnaskedDevice.wire`."""
        return self._model.wire()

    def identify(self) -> Script[DeviceInfo]:
        """As `Device.identify`: by its packets."""
        runs = yield from hear_runs(self.wire, self._talkers.heard, self.patience_s, self.wake)
        self._model = self._named or self._talkers.unnamed(max(runs, key=len))
        told_us = [each for each in map(self._talkers.sample_us, runs) if each]
        self._sample_us = median(told_us) if told_us else self._model.sample_us
        return DeviceInfo(self._talkers.family, self._model.title, 0, "", 0, "")

    def health(self) -> Script[Health]:
        """As `Device.health`: with a note where it may be another model."""
        health = yield from super().health()
        return replace(health, note=self._model.note)

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
        return Stream(
            format=wire,
            decoder=self._model.decoder(),
            mode=mode,
            sample_ns=self._sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=self._talkers.slowest_turn_s,
        )
