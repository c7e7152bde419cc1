"""Streams of more models, each as it is sold: their formats, and what a fault table of them needs.

`benchmarks.streams` has the seven formats that all benchmarks run over. Here stand the relatives: models that are
slower, that have other samples, whose motor is switched by the control line DTR, or that only talk. A revolution of
theirs is short, so they reach fewer megabytes a second than the seven.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from benchmarks.streams import RATES, Kind, rplidar_kind, simulated
from lidario.basics.model import ScanMode
from lidario.families import camsense, hlds, irobotix, neato
from lidario.families.hokuyo.commands import measure
from lidario.families.hokuyo.decode import BlockDecoder
from lidario.families.hokuyo.formats import DistanceFormat
from lidario.families.hokuyo.geometry import Geometry
from lidario.families.ldrobot.decode import TriangleDecoder
from lidario.families.ldrobot.formats import PacketFormat, TriangleFormat
from lidario.families.rplidar.simulated.device import PROFILES
from lidario.families.scripts import begin
from lidario.families.talking import Talkers
from lidario.families.two_angles import TwoAngleDecoder
from lidario.families.ydlidar import commands as ydlidar_commands
from lidario.families.ydlidar.models import MODELS as YDLIDARS
from lidario.wire.envelope import Request
from lidario.wire.formats import StreamFormat


@dataclass(frozen=True, slots=True)
class Sufferer:
    """A device in the fault table.

    Attributes:
        kind: What it sends.
        mode: The scan mode that is asked for; None for the one that it recommends.
    """

    kind: Kind
    mode: str | None = None


def _rplidar(model: str, mode_id: int) -> Kind:
    profile = PROFILES[model]
    mode = next(each for each in profile.modes if each.id == mode_id)
    return rplidar_kind(f"{model} {mode.name}", profile, mode)


def _ydlidar(model: str) -> Kind:
    about = YDLIDARS[model]
    mode = about.mode
    request: Callable[[StreamFormat], Request] = begin if about.one_way else ydlidar_commands.scan
    device = partial(simulated, f"ydlidar-{model}")
    return Kind(f"{about.title} points", "ydlidar", mode, device, about.kind.wire, about.kind.decoder, request)


def _ldrobot(model: str, title: str, rate: float, *, triangle: bool = False) -> Kind:
    wire = TriangleFormat if triangle else PacketFormat
    mode = ScanMode(0, "Standard", 1e6 / rate, 12.0, wire.response_type, typical=True)
    decoder = partial(TriangleDecoder if triangle else TwoAngleDecoder, wire)
    return Kind(f"{title} packets", "ldrobot", mode, partial(simulated, model), wire, decoder, begin)


def _talker(talkers: Talkers, name_of_device: str, name: str) -> Kind:
    """One of a family whose models a table describes; `name` is that of its packets."""
    model = talkers.models.get(name_of_device.partition("-")[2], talkers.all[-1])
    mode = ScanMode(0, "Standard", model.sample_us, model.reach, model.wire().response_type, typical=True)
    request = partial(begin, data=model.start)
    return Kind(name, talkers.family, mode, partial(simulated, name_of_device), model.wire, model.decoder, request)


def _urg() -> Kind:
    field = Geometry(44, 725, 384, 1024, 20, 5600, 600)
    mode = ScanMode(0, "Standard", field.sample_us, 5.6, DistanceFormat.response_type, typical=True)
    return Kind(
        "URG-04LX blocks",
        "hokuyo",
        mode,
        partial(simulated, "hokuyo-urg04lx"),
        partial(DistanceFormat, field),
        partial(BlockDecoder, DistanceFormat, field),
        partial(measure, "MD", field.first, field.last),
    )


FORMATS: Final = {
    kind.name: kind
    for kind in (
        _ydlidar("x4"),
        _ydlidar("g6"),
        _ydlidar("g2"),
        _ydlidar("tmini"),
        _ydlidar("tmini-plus-sh"),
        _ldrobot("ldrobot-ld19", "LD19", 4500.0),
        _ldrobot("ldrobot-ld14p", "LD14P", 4000.0, triangle=True),
        _talker(neato.TALKERS, "neato-xv11", "XV-11 packets"),
        _talker(camsense.TALKERS, "camsense-x1", "Camsense X1 packets"),
        _talker(irobotix.TALKERS, "irobotix-delta2a", "Delta-2A frames"),
        _talker(hlds.TALKERS, "hlds-lds01", "LDS-01 packets"),
        _urg(),
    )
}
"""One stream of each format that is not among the seven of `benchmarks.streams`."""

SUFFERERS: Final = {
    "rplidar-s2": Sufferer(RATES["S2 DenseBoost"].kind),
    "ydlidar-4ros": Sufferer(RATES["4ROS"].kind),
    "rplidar-a1": Sufferer(_rplidar("rplidar-a1", 0), "Standard"),
    "rplidar-c1": Sufferer(_rplidar("rplidar-c1", 1)),
    "ldrobot-ld06": Sufferer(_ldrobot("ldrobot-ld06", "LD06", 4546.0)),
    "ydlidar-x4": Sufferer(FORMATS["X4 points"]),
    "ydlidar-g2": Sufferer(FORMATS["G2 points"]),
    "ydlidar-tmini": Sufferer(FORMATS["Tmini points"]),
    "ydlidar-x2": Sufferer(_ydlidar("x2")),
    "neato-xv11": Sufferer(FORMATS["XV-11 packets"]),
    "camsense-x1": Sufferer(FORMATS["Camsense X1 packets"]),
    "irobotix-delta2a": Sufferer(FORMATS["Delta-2A frames"]),
    "hlds-lds01": Sufferer(FORMATS["LDS-01 packets"]),
    "hokuyo-urg04lx": Sufferer(FORMATS["URG-04LX blocks"]),
}
"""The devices of the fault table, by the name of the simulated model."""
