"""Recorded bytes of this family: finds where the measurement stream begins, and which model sent it.

The stream begins behind the scan header (4ROS development manual, 3.1), or with the first intact packet if the
header was not recorded. How samples are to be read depends on the model. It is known by device information that was
recorded before the stream, or by the user. Otherwise it is guessed: a model measures at one of a few rates, and the
rate is the number of samples in a revolution times the speed, which start packets tell. The bytes carry no times.
Models that only talk also tell a code, at power-on (X2 manual, 3). A model that responds may have the same code:
its stream has a header.
"""

import math
import re
from typing import Final, NamedTuple

import numpy as np

from lidario.basics.model import ScanMode
from lidario.families.base import Decoder, Known, RawStream, raw_stream, runs_in
from lidario.families.ydlidar.decode import KINDS
from lidario.families.ydlidar.formats import FORMATS, FULL_TURN_Q6, INFO_HEADER, START_BIT, PointCloud, packet_heads
from lidario.families.ydlidar.models import MODELS, Model
from lidario.wire.events import Packets
from lidario.wire.formats import StreamFormat
from lidario.wire.link import Link

_HEADER: Final = re.compile(rb"\xa5\x5a.{3}[\x40-\x7f]\x81", re.DOTALL)
"""The scan header; the length in it is to be ignored (manual 3.1)."""
_LIKELY: Final = tuple(MODELS[name] for name in ("4ros", "x4", "g6", "tmini", "g2", "tmini-plus-sh"))
_MODELS: Final = (*_LIKELY, *(model for model in MODELS.values() if model not in _LIKELY))
"""All models; of those that fit, the first one is taken."""
_MEASURED: Final = 64 * 1024  # bytes from which samples a revolution and speed are found
_UNLIKE: Final = 0.08
"""Share by which a rate may differ from that of a model. Speeds are told in tenths of Hz, and TG models, by the
vendor's SDK, tell 0.4 Hz too much."""
_ALIKE: Final = 0.03  # two differences closer than this count as equal: the speed of a motor varies by as much
_SPEEDS: Final = (4.0, 13.0)  # Hz: the speeds of all models (4 to 12), and a little more
_USUAL_HZ: Final = 8.0


class Turn(NamedTuple):
    """What packets tell about a revolution."""

    samples: float  # samples of a revolution; 0 if unknown
    code: float  # number that stands for the speed; 0 if none was told

    def hertz(self, model: Model) -> float:
        """The speed that packets tell if the device is of that model, in Hz; 0 if they tell none."""
        return (self.code + model.kind.speed_base) / 10 if self.code or model.kind.speed_base else 0.0

    def unlike(self, model: Model) -> float:
        """Share by which the rate differs from the nearest rate of that model; infinite if no speed fits."""
        hertz, (slowest, fastest) = self.hertz(model), _SPEEDS
        if hertz:
            off = min(abs(self.samples * hertz / rate - 1) for rate in model.rates)
            return off if slowest <= hertz <= fastest else math.inf
        fits = self.samples and any(slowest <= rate / self.samples <= fastest for rate in model.rates)
        return 0.0 if fits else math.inf

    def rate(self, model: Model) -> float:
        """Samples a second of that model: its nearest rate, or the rate that packets tell if none is near."""
        hertz = self.hertz(model)
        seen = self.samples * (hertz or _USUAL_HZ)
        if not seen:
            # The lowest rate, so that no revolution seems too long.
            return min(model.rates)
        near = min(model.rates, key=lambda rate: abs(math.log(rate / seen)))
        return seen if hertz and len(model.rates) > 1 and abs(seen / near - 1) > _UNLIKE else near


def find_stream(data: memoryview, known: Known) -> RawStream | None:
    """As `Family.find_stream`: finds the stream behind the header, or at the first intact packet."""
    named = MODELS[known.model] if known.model else None
    found: list[tuple[int, type[PointCloud]]] = []
    # Mostly a stream begins soon: the formats that it does not have are not looked for to the end of the data.
    for near in (data[:_MEASURED], data):
        for made in FORMATS if named is None else (named.kind.wire,):
            # A later packet does not count.
            searched = near if not found else data[: found[0][0] + made.longest]
            first = next(runs_in(searched, made(), 1), None)
            if first is not None:
                found.append((first[0], made))
        if found:
            break
    else:
        return None
    if len(found) > 1:
        # One packet may pass for a packet of another format, and two packets for one if the last samples are 0.
        # The format with the most bytes in packets is right; of two that have as many, the longer one.
        found.sort(key=lambda each: len(each[1]().packets_in(bytearray(data[each[0] :][:_MEASURED]))[1]))
    begin, made = found[-1]
    turn = turn_in(data[begin : begin + _MEASURED], made())
    header = _HEADER.search(data[:begin])
    told = [named] if named else _told(data[:begin], responds=header is not None)
    told = [model for model in told if model.kind.wire is made]
    if len({(model.kind, model.rates) for model in told}) == 1:
        model, guess = told[0], ""
    else:
        model, guess = _guessed(turn, told or [model for model in _MODELS if model.kind.wire is made])
    return raw_stream(
        begin if header is None else header.end(),
        model.kind.wire(),
        model.kind.decoder(),
        known.sample_us or 1e6 / turn.rate(model),
        f"YDLIDAR {model.title}",
        guess,
        model.kind.response_type,
    )


def _told(before: memoryview, *, responds: bool) -> list[Model]:
    """The models that have the code in recorded device information; empty if these bytes contain none."""
    at = bytes(before).rfind(INFO_HEADER)
    code = before[at + len(INFO_HEADER)] if 0 <= at < len(before) - len(INFO_HEADER) else -1
    return [model for model in _MODELS if code in model.codes and not (responds and model.one_way)]


def turn_in(data: memoryview, wire: PointCloud) -> Turn:
    """Find samples and speed of a revolution from packets."""
    link = Link()
    link.enter_stream(wire)
    link.receive_data(data, 0)
    steps, codes = list[float](), list[int]()
    for event in link.events_received():
        if isinstance(event, Packets):
            heads = packet_heads(event).astype(np.int32)
            counts, ways = heads[:, 1] >> 8, ((heads[:, 3] >> 1) - (heads[:, 2] >> 1)) % FULL_TURN_Q6
            several = counts > 1
            steps += (ways[several] / (counts[several] - 1)).tolist()
            told = heads[heads[:, 1] & START_BIT != 0, 1] & 0xFF
            codes += (told[told > START_BIT] >> 1).tolist()
    step = float(np.median(steps or 0))
    return Turn(FULL_TURN_Q6 / step if step else 0.0, float(np.median(codes or 0)))


def _guessed(turn: Turn, models: list[Model]) -> tuple[Model, str]:
    """The likeliest of these models, and a sentence for the user about the guess."""
    fitting = [model for model in models if turn.unlike(model) <= _UNLIKE]
    # Models with equal differences stay in their order.
    fitting.sort(key=lambda model: turn.unlike(model) // _ALIKE)
    model = (fitting or models)[0]
    by = f"{turn.samples:.0f} samples a revolution"
    if turn.code:
        by += f" at {turn.hertz(model):.1f} Hz"
    words = f"which YDLIDAR sent these bytes is a guess: {model.title}, by {by}"
    if not fitting:
        words += ", which no model that is known has"
    others = [other.name for other in fitting if other.kind is not model.kind]
    if others:
        words += f"; {', '.join(others)} would fit as well, with other distances or angles"
    return model, f"{words}. Name the model, as in model={model.name}"


def stream_in(mode: ScanMode) -> tuple[StreamFormat, Decoder] | None:
    """As `Family.stream_in`: by the response type, a number that lidario gives each kind."""
    kind = next((kind for kind in KINDS.values() if kind.response_type == mode.response_type), None)
    return None if kind is None else (kind.wire(), kind.decoder())
