"""The simulated models, and what they tell of themselves in lines of text."""

from __future__ import annotations

from dataclasses import dataclass

from lidario.sim.chassis import by_name

USB, ETHERNET = 12_000_000, 100_000_000


@dataclass(frozen=True, slots=True)
class Profile:
    """What kind of device it is.

    Attributes:
        name: Its name in ``sim://`` sources.
        model: Decides what is random.
        product: As it calls itself.
        line: Speed at which bytes leave, in bits a second.
        turn: Steps of 360 degrees.
        span: First and last step.
        front: The step straight ahead.
        reach_mm: Nearest and farthest distance.
        rpm: Revolutions a minute.
        intensity: Whether it knows ``ME``.
        nothing: What it sends where nothing came back.
        counts_semicolon: Whether the ``;`` of a line belongs to its sum.
        baudrate: What a serial port is set to; by USB and TCP that means nothing.
        begins_scip1: Whether it speaks SCIP 1.1 until it is told ``SCIP2.0``.
    """

    name: str
    model: int
    product: str
    line: int = USB
    turn: int = 1440
    span: tuple[int, int] = (0, 1080)
    front: int = 540
    reach_mm: tuple[int, int] = (20, 30_000)
    rpm: int = 2400
    intensity: bool = True
    nothing: int = 65_533
    counts_semicolon: bool = False
    baudrate: int = 115_200
    begins_scip1: bool = False

    @property
    def about(self) -> str:
        """What it is, in a few words."""
        line, steps = "USB" if self.line == USB else "TCP", self.span[1] - self.span[0]
        return f"{line}, {self.rpm // 60} scans/s of {steps + 1} steps, {steps * 360 / self.turn:.0f} degrees"


PROFILES = by_name(
    Profile(
        "hokuyo-urg04lx", 1, "URG-04LX", turn=1024, span=(44, 725), front=384, reach_mm=(20, 5600), rpm=600,
        intensity=False, nothing=0, counts_semicolon=True,
    ),
    Profile("hokuyo-ust10lx", 2, "UST-10LX", line=ETHERNET),
    Profile("hokuyo-ust20lx", 3, "UST-20LX", line=ETHERNET, reach_mm=(20, 60_000)),
    Profile("hokuyo-utm30lx", 4, "UTM-30LX", reach_mm=(23, 60_000), nothing=1),
)  # fmt: skip


def texts_of(of: Profile, serial: str, laser: str, doing: str, clock: int, state: str) -> dict[str, list[str]]:
    """The lines of each response that consists of them, by its request."""
    return {
        "VV": [
            "VEND:Hokuyo Automatic Co.,Ltd.",
            f"PROD:SOKUIKI Sensor {of.product}",
            "FIRM:3.4.03(17/Dec./2012)",
            "PROT:SCIP 2.0",
            f"SERI:{serial}",
        ],
        "PP": [
            f"MODL:{of.product}(Hokuyo Automatic Co.,Ltd.)",
            f"DMIN:{of.reach_mm[0]}",
            f"DMAX:{of.reach_mm[1]}",
            f"ARES:{of.turn}",
            f"AMIN:{of.span[0]}",
            f"AMAX:{of.span[1]}",
            f"AFRT:{of.front}",
            f"SCAN:{of.rpm}",
        ],
        "II": [
            f"MODL:{of.product}",
            f"LASR:{laser}",
            f"SCSP:{of.rpm}",
            f"MESM:{doing}",
            "SBPS:USB 2.0",
            f"TIME:{clock:06X}",
            f"STAT:{state}",
        ],
    }
