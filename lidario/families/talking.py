"""Tables of models that only talk: what a family of such needs beside packets and decoder.

No packet of theirs tells the model; where models are to be read in different ways, a user names one. What a sample
takes is measured by the packets that are heard when the device is opened, or found in recorded bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from lidario.families.base import Decoder, Known, RawStream, raw_stream
from lidario.families.unasked import LINKED
from lidario.model import ScanMode
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat


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
        name: As in ``model=`` of a source; empty of one that no user names.
        title: For people.
        baudrates: Speeds that its line may have, the likeliest first.
        sample_us: What a sample takes by its data sheet, microseconds.
        reach: Farthest distance in metres.
        wire: The format of its packets.
        make_decoder: Makes their decoder, by the format.
        note: What else it may be, where its packets do not tell.
        start: What starts its motor and its stream; empty where it talks for as long as it has power.
        stop: What stops both; empty likewise.
        speeds: How the motor is regulated; None where it cannot be.
        slowest_turn_s: Longest time that one revolution may take: at the lowest speed, and half as long
            again. Default: at 200 revolutions a minute.
    """

    name: str
    title: str
    baudrates: tuple[int, ...]
    sample_us: float
    reach: float
    wire: type[StreamFormat]
    make_decoder: Callable[[Any], Decoder]
    note: str = ""
    start: bytes = b""
    stop: bytes = b""
    speeds: Speeds | None = None
    slowest_turn_s: float = 0.45

    def decoder(self) -> Decoder:
        """A fresh decoder."""
        return self.make_decoder(self.wire)


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
        all: All that is to be read in some way; those with a name are those that a user may name.
        unnamed: Which model it is, where no user has named one: by packets, of which most are in a row, and by the
            speed of the line, as `Device.baudrate` has it.
        heard: Packets in a row from which that is known, and what a sample takes, if they tell it.
        wires: The formats in which to look for packets, the likeliest first; none for that of any model.
        rotor: Where the host powers the motor.
    """

    family: str
    all: tuple[TalkingModel, ...]
    unnamed: Callable[[bytes, int | None], TalkingModel]
    heard: int
    wires: tuple[type[StreamFormat], ...] = ()
    rotor: Rotor | None = None

    @property
    def models(self) -> dict[str, TalkingModel]:
        """Those that a user may name."""
        return {model.name: model for model in self.all if model.name}

    def model_of(self, named: TalkingModel | None, packets: bytes, baudrate: int | None = None) -> TalkingModel:
        """The model that the user has named, if any, with a note where packets are those of another one."""
        seen = self.unnamed(packets, baudrate)
        if named is None:
            return seen
        # Where a note stands they do not tell.
        if seen.note or seen.wire is named.wire:
            return named
        said = f"its packets are such as a {seen.title} sends, and are read as those of a {named.title}"
        return replace(named, note=f"{said}: leave out ?model={named.name}")

    def wires_of(self, named: TalkingModel | None) -> tuple[type[StreamFormat], ...]:
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
                # Also where one packet is proof enough: it tells no model.
                if sum(block.packets for block in run.packets) >= LINKED:
                    heard = bytes(rows[: run.end])
                    model = self.model_of(named, heard)
                    sample_us = known.sample_us or model.wire.sample_us(heard) or model.sample_us
                    return raw_stream(at, model.wire(), model.decoder(), sample_us, model.title, model.note)
        return None

    def stream_in(self, mode: ScanMode) -> tuple[StreamFormat, Decoder] | None:
        """As `Family.stream_in`: by the number that lidario gives each kind."""
        found = (model for model in self.all if model.wire().response_type == mode.response_type)
        return next(((model.wire(), model.decoder()) for model in found), None)
