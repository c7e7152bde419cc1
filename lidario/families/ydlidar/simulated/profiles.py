"""The simulated models: rates, layouts and which requests each hears.

Sources: 4ROS development manual and data sheet; for the others the vendor's SDK 1.2.20 and its tables of models.
What some do beside that was seen in bytes of real devices (`Profile.follows`): no speed in the start packets of an
X4, which sends from 6 to 22 degrees a packet while its motor speeds up; start packets at 108.05 degrees (TG15) and
351.19 (a device like an X2); one sample behind the seam that still belongs to the revolution before (Tmini Plus);
bits in the CT byte of ordinary packets (Tmini Pro: that there are some is known, not which).
One-way models have no line on which a request could arrive. Which models know the second health request instead of
the first is not documented: the SDK asks those that triangulate by the second.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

from lidario.families.ydlidar.simulated.packers import MILLIMETRES, Layout
from lidario.sim.chassis import by_name

_SPEED = frozenset({0x09, 0x0A, 0x0B, 0x0C, 0x0D})
_ALL = frozenset({0x00, 0x60, 0x65, 0x80, 0x90, 0x93, 0xD9}) | _SPEED
_NO_SPEED = _ALL - _SPEED - {0x93, 0xD9}
_NONE = frozenset[int]()
_QUARTERS = Layout(unit=4)
_EIGHT = Layout(3, 4, flags=True, bits=8)


@dataclass(frozen=True, slots=True)
class Profile:
    """What kind of device it is."""

    name: str  # its name in ``sim://`` sources
    model: int = 101  # model number
    # The health request that it responds to: 0x91 as in the manual, or 0x92 as in the SDK.
    health_command: int = 0x91
    spin_up_s: float = 1.0  # seconds the motor needs from standstill to a stable speed
    stamps: bool = False  # whether a time stamp record stands before each packet, as on some relatives of the 4ROS
    baudrate: int = 512_000  # speed of its line
    sample_ns: int = 50_000  # nanoseconds a sample
    layout: Layout = MILLIMETRES  # how a sample lies in its bytes
    triangle: bool = False  # whether the angle depends on the distance
    speed_base: int = 30  # tenths of Hz that the speed 0 in a start packet stands for
    reach_mm: tuple[float, float] = (50.0, 30_000.0)  # nearest and farthest distance
    factory_speed: int = 700  # hundredths of Hz
    speeds: tuple[int, int] = (500, 1200)  # the slowest and the fastest that can be set
    commands: frozenset[int] = _ALL  # the requests that it knows besides health; none: it only talks
    # Whether it is dark while the host clears DTR (users of the X4; the SDK asserts it for these).
    by_dtr: bool = False
    tells_speed: bool = True  # whether its start packets tell a speed; those of three recordings of real X4s do not
    # Samples of an ordinary packet (40: by a comment in the vendor's SDK; the manual tells none).
    per_packet: int = 40
    seam_deg: float = 0.0  # where its revolutions begin
    # In one revolution of so many the start packet comes a sample late, and the sample before it stands in a packet
    # of its own; 0: in none.
    late_seam: int = 0
    control: int = 0  # the CT byte of ordinary packets; only its bit 0 has a meaning
    early_hertz: float = 0.0  # from which speed on it sends while its motor speeds up; 0: when that has its speed
    # Whether it sends device information after a RESET, unasked (the vendor's SDK waits for it; the manual of the
    # 4ROS knows no response).
    announces: bool = True
    firmware: tuple[int, int] = (3, 1)  # major and minor number
    follows: str = ""  # which recording of a real device it follows, for people; empty where there is none

    @property
    def one_way(self) -> bool:
        """Whether it only talks."""
        return not self.commands

    @property
    def about(self) -> str:
        """What it is, in a few words."""
        talks = "; only talks" if self.one_way else ""
        motor = ", motor by DTR" if self.by_dtr else ""
        follows = f"; like {self.follows}" if self.follows else ""
        return f"{self.baudrate} baud, {1e9 / self.sample_ns:.0f}/s{motor}{talks}{follows}"


def _triangle(
    name: str,
    model: int,
    baudrate: int,
    per_second: int,
    layout: Layout = _QUARTERS,
    commands: frozenset[int] = _ALL,
    *,
    triangle: bool = True,
    **more: Any,
) -> Profile:
    return Profile(
        name,
        model,
        health_command=0x92 if triangle else 0x91,
        baudrate=baudrate,
        sample_ns=1_000_000_000 // per_second,
        layout=layout,
        triangle=triangle,
        speed_base=30 if layout is MILLIMETRES else 0,
        reach_mm=(100.0, 12_000.0),
        factory_speed=700 if commands else 600,
        speeds=(500, 1200) if triangle else (600, 1200),
        by_dtr=model in (4, 6, 11) and name not in ("ydlidar-x3", "ydlidar-x4-pro"),
        commands=commands - (frozenset() if model in (9, 14, 15, 16, 19) else {0x93}) - {0xD9},
        **more,
    )


_beam = partial(_triangle, triangle=False)
PROFILES = by_name(
    Profile("ydlidar-4ros", announces=False),
    Profile("ydlidar-4ros-92", health_command=0x92),
    Profile("ydlidar-4ros-slow", spin_up_s=2.5),
    Profile("ydlidar-4ros-stamps", stamps=True),
    Profile("ydlidar-4ros-long", per_packet=200),
    Profile("ydlidar-tg15", model=100, seam_deg=108.05, follows="two packets in a README"),
    Profile("ydlidar-tg50", model=102),
    _triangle("ydlidar-x4", 6, 128_000, 5000, commands=_NO_SPEED, tells_speed=False, early_hertz=2.0,
              follows="deepakkamesh/ydlidar"),
    _triangle("ydlidar-g1", 19, 230_400, 9000),
    _triangle("ydlidar-g2", 15, 230_400, 5000, Layout(3, 4, flags=True, bits=10)),
    _triangle("ydlidar-g4", 5, 230_400, 9000),
    _triangle("ydlidar-g6", 13, 512_000, 18_000, Layout(unit=2)),
    _triangle("ydlidar-r2", 9, 230_400, 5000),
    _triangle("ydlidar-f4", 1, 115_200, 4000),
    _triangle("ydlidar-s4b", 11, 153_600, 4000, _EIGHT, _NO_SPEED),
    _beam("ydlidar-tmini", 140, 230_400, 4000, _EIGHT),
    _beam("ydlidar-tmini-pro", 150, 230_400, 4000, _EIGHT, control=0x06, follows="tier4/ydlidar_driver"),
    _beam("ydlidar-tmini-plus", 151, 230_400, 4000, _EIGHT, late_seam=8, follows="Ar-Ray-code/tmini_plus_emulator"),
    _beam("ydlidar-tmini-plus-sh", 152, 230_400, 4000, Layout(4, 1, bits=16)),
    _triangle("ydlidar-x2", 6, 115_200, 3000, commands=_NONE, tells_speed=False, seam_deg=351.19,
              follows="a packet of one"),
    _triangle("ydlidar-x3", 6, 115_200, 3000, commands=_NONE),
    _triangle("ydlidar-x4-pro", 6, 128_000, 5000, Layout(unit=4, flags=True), _NONE),
    _triangle("ydlidar-s2-pro", 4, 115_200, 3000, commands=_NONE),
    _beam("ydlidar-tx8", 100, 115_200, 4000, MILLIMETRES, _NONE),
)  # fmt: skip
