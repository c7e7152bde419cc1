"""The table of YDLIDAR models: samples, speeds, and which requests they hear.

Codes, layouts and speeds: the vendor's SDK 1.2.20 and its tables of models; the 4ROS by its own manual and data
sheet. Only streams of the X4, G2, G6, Tmini Pro and TG15 were compared with what that SDK decodes. No real device
was tried.

Three codes are ambiguous: 6 is that of the X2, X3, X4 and X4 Pro, 100 that of the TG15 and TX8, 4 that of the S4,
the S2 Pro and some S4B. Of these only the X4, the TG15, the S4 and the S4B hear requests, so a device that responds
is one of them. The speed of the line distinguishes S4 and S4B (more_families.md A1). A model that only talks does
not tell its model: it is always taken for an X2 unless a user names it, as in ``?model=tx8``.
"""

from dataclasses import dataclass
from typing import Final

from lidario.basics.model import ScanMode
from lidario.families.ydlidar.decode import KINDS, Kind


@dataclass(frozen=True, slots=True)
class Model:
    """One model."""

    name: str  # as in ``model=`` of a source
    title: str  # for people
    code: int  # number of the model in device information
    baudrate: int  # speed of its line
    kind: Kind  # how its samples are to be read
    # Samples a second; several if one of them can be set. Not every model can be asked which one is set.
    rates: tuple[float, ...]
    # The slowest and the fastest scan frequency that can be set, in Hz; None if none can be set.
    speeds: tuple[float, float] | None = (5.0, 12.0)
    one_way: bool = False  # whether it only talks
    offset: bool = False  # whether it can be asked for its zero-angle offset
    # Above this firmware the offset is in hundredths of a degree; None if it is always in quarters.
    fine_above: tuple[int, int] | None = None
    protection: bool = False  # whether it has power-down protection that may be toggled
    reach: float = 12.0  # farthest distance in metres
    dtr: bool = False  # whether its motor turns only while DTR is asserted
    other_code: int | None = None  # number that some devices tell instead of `code`; None if there is none

    @property
    def codes(self) -> tuple[int | None, ...]:
        """All model numbers that it may tell."""
        return self.code, self.other_code

    @property
    def hears_at_rest(self) -> bool:
        """Whether it responds while its motor stands."""
        return not (self.one_way or self.dtr)

    @property
    def mode(self) -> ScanMode:
        """Its one scan mode."""
        # With several rates, the time of a sample is not known.
        sample_us = 1e6 / self.rates[0] if len(self.rates) == 1 else 0.0
        return ScanMode(0, "Standard", sample_us, self.reach, self.kind.response_type, typical=True)


_TG_RATES: Final = (20_000, 18_000, 10_000)
_G6_RATES: Final = (18_000, 16_000, 8000)
_G4_RATES: Final = (10_000, 9000, 8000, 4000)  # ydlidar_4ros.md 4
_TG, _X, _G2, _TMINI = (KINDS[name] for name in ("tg", "x", "g2", "tmini"))

FOUR_ROS: Final = Model("4ros", "4ROS", 101, 512_000, _TG, (20_000,), offset=True, protection=True, reach=30.0)
"""The code is the TG30's in the SDK. 20000 samples a second, 30 m, 5 to 12 Hz: data sheet."""
ONE_WAY: Final = Model("", "X2, X3 or alike", 6, 115_200, _X, (), None, one_way=True, reach=8.0)
"""A model that only talks and that no user has named."""

MODELS: Final = {
    model.name: model
    for model in (
        FOUR_ROS,
        Model("tg15", "TG15", 100, 512_000, _TG, _TG_RATES, offset=True, protection=True, reach=15.0),
        Model("tg30", "TG30", 101, 512_000, _TG, (20_000,), offset=True, protection=True, reach=30.0),
        Model("tg50", "TG50", 102, 512_000, _TG, _TG_RATES, offset=True, protection=True, reach=50.0),
        Model("x4", "X4", 6, 128_000, _X, (5000,), None, reach=10.0, dtr=True),
        Model("s4", "S4", 4, 115_200, _X, (4000,), None, reach=8.0, dtr=True),
        Model("s4b", "S4B", 11, 153_600, KINDS["s4b"], (4000,), None, reach=8.0, dtr=True, other_code=4),
        Model("f4", "F4", 1, 115_200, _X, (4000,)),
        Model("f4pro", "F4 Pro", 8, 230_400, _X, (4000, 6000)),
        Model("g1", "G1", 19, 230_400, _X, (9000,), offset=True),
        Model("g2", "G2", 15, 230_400, _G2, (5000,), offset=True),
        Model("g2a", "G2A", 14, 230_400, _X, (5000,), offset=True),
        Model("g2c", "G2C", 16, 115_200, _X, (4000,), offset=True),
        Model("g4", "G4", 5, 230_400, _X, _G4_RATES, reach=16.0),
        Model("g4pro", "G4 Pro", 7, 230_400, _X, _G4_RATES, reach=16.0),
        Model("g4b", "G4B", 17, 512_000, _G2, (10_000,), reach=16.0),
        Model("g4c", "G4C", 18, 115_200, _X, (4000,), reach=16.0),
        Model("g5", "G5", 20, 230_400, _X, _G4_RATES, reach=16.0),
        Model("g6", "G6", 13, 512_000, KINDS["octave"], _G6_RATES, reach=25.0),
        Model("g7", "G7", 21, 512_000, KINDS["octave"], _G6_RATES, reach=25.0),
        Model("r2", "R2", 9, 230_400, _X, (5000,), offset=True, fine_above=(1, 7)),
        Model("tsa-pro", "TSA Pro", 131, 230_400, _TMINI, (4000,), (6.0, 12.0)),
        Model("tmini", "Tmini", 140, 230_400, _TMINI, (4000,), (6.0, 12.0)),
        Model("tmini-pro", "Tmini Pro", 150, 230_400, _TMINI, (4000,), (6.0, 12.0)),
        Model("tmini-plus", "Tmini Plus", 151, 230_400, _TMINI, (4000,), (6.0, 12.0)),
        Model("tmini-plus-sh", "Tmini Plus SH", 152, 230_400, KINDS["sh"], (4000,), (6.0, 12.0)),
        Model("x2", "X2", 6, 115_200, _X, (3000,), None, one_way=True, reach=8.0, dtr=True),
        Model("x3", "X3", 6, 115_200, _X, (3000,), None, one_way=True, reach=8.0),
        Model("x4pro", "X4 Pro", 6, 128_000, KINDS["x-flags"], (5000,), None, one_way=True, reach=10.0),
        Model("s2pro", "S2 Pro", 4, 115_200, _X, (3000,), None, one_way=True, reach=8.0, dtr=True),
        Model("tx8", "TX8", 100, 115_200, _TG, (4000,), None, one_way=True, reach=8.0),
    )
}
"""Every model by the name that a user may give it."""


def model_of(code: int, baudrate: int | None = None) -> Model | None:
    """The model with that code that hears requests; of several, the one with that line speed; None if unknown."""
    known = [model for model in MODELS.values() if code in model.codes and not model.one_way]
    return min(known, key=lambda model: model.baudrate != baudrate, default=None)
