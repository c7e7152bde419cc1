"""The device side: it listens to lines of text, and measures only when it is told to.

The motor of a real device turns as long as it has power, and nothing can be asked of it. So ``motor_on`` tells of
the laser, which ``BM`` and a request to measure switch on, and ``QT`` and ``RS`` off; `Chassis.spin_up_s` is how
long the first scan waits for it. A scan begins every turn, and is sent when its last step was measured. Its clock
is that of its first step.

Lines and statuses are written from the SCIP 2.0 specification alone, the states of ``%ST`` from hokuyolx 0.9.0.
What it says of itself are the words of real devices, in transcripts of their users. That ``TM1`` tells the clock at
any time, that ``RS`` has a response and an empty line has none, a simulator tells that was held against real ones
(seqsense/urg_stamped). Made up: how long ``RS`` takes. One that begins in SCIP 1.1 responds with ``E`` to all but
``SCIP2.0`` (more_families_2.md 6.1), and begins so again after ``RS`` (made up).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
import numpy.typing as npt

from lidario.sim.chassis import Chassis, Maker, Making, by_name, maker
from lidario.sim.line import TransmitQueue

_LONGEST_LINE = 80
_LINE = 64
_NAMES = {
    "VV": "get_info", "PP": "get_parameters", "II": "get_health", "BM": "laser_on", "QT": "stop", "RS": "reset",
    "MD": "start", "ME": "start_intensity", "GD": "get_scan", "GE": "get_scan_intensity", "TM": "clock",
    "SC": "leave_scip1", "SS": "set_speed", "%S": "get_laser_state", "HS": "sensitivity", "CR": "motor_speed",
}  # fmt: skip
_STATUSES = {"QT": "00", "RS": "00", "HS0": "00", "HS1": "00", "CR00": "00"}
_MEASURE = re.compile(r"(M[DE])(\d{4})(\d{4})(\d{2})(\d)(\d{2})", re.ASCII)
_ONCE = re.compile(r"(G[DE])(\d{4})(\d{4})(\d{2})", re.ASCII)

USB, ETHERNET = 12_000_000, 100_000_000


@dataclass(frozen=True, slots=True)
class Profile:
    """What kind of device it is."""

    name: str  # its name in ``sim://`` sources
    model: int  # decides what is random
    product: str  # as it calls itself
    told: tuple[str, str]  # its vendor's name for it, and its firmware
    well: str  # what it says of its state
    line: int = USB  # speed at which bytes leave, in bits a second
    turn: int = 1440  # steps of 360 degrees
    span: tuple[int, int] = (0, 1080)  # first and last step
    front: int = 540  # the step straight ahead
    reach_mm: tuple[int, int] = (20, 30_000)  # nearest and farthest distance
    rpm: int = 2400  # revolutions a minute
    intensity: bool = True  # whether it knows ``ME``
    nothing: int = 65_533  # what it sends where nothing came back
    counts_semicolon: bool = False  # whether the ``;`` of a line belongs to its sum
    baudrate: int = 115_200  # what a serial port is set to; by USB and TCP that means nothing
    begins_scip1: bool = False  # whether it speaks SCIP 1.1 until it is told ``SCIP2.0``

    @property
    def about(self) -> str:
        """What it is, in a few words."""
        line, steps = "USB" if self.line == USB else "TCP", self.span[1] - self.span[0]
        return f"{line}, {self.rpm // 60} scans/s of {steps + 1} steps, {steps * 360 / self.turn:.0f} degrees"


_NORMAL = "sensor is working normally"
PROFILES = by_name(
    Profile(
        "hokuyo-urg04lx", 1, "URG-04LX", ("SOKUIKI Sensor URG-04LX", "3.4.03(17/Dec./2012)"), "Sensor works well.",
        turn=1024, span=(44, 725), front=384, reach_mm=(20, 5600), rpm=600, intensity=False, nothing=0,
    ),
    Profile("hokuyo-ust10lx", 2, "UST-10LX", ("UST-10LX", "2.23.0000"), _NORMAL, line=ETHERNET),
    Profile(
        "hokuyo-ust20lx", 3, "UST-20LX", ("UST-20LX", "2.23.0000"), _NORMAL, line=ETHERNET, reach_mm=(20, 60_000)
    ),
    Profile(
        "hokuyo-utm30lx", 4, "UTM-30LX", ("SOKUIKI Sensor TOP-URG UTM-30LX", "1.16.01(16/Nov./2009)"),
        "Stable 000 no error.", reach_mm=(23, 60_000), nothing=1,
    ),
)  # fmt: skip


@dataclass(slots=True)
class _Stream:
    """What is measured, until it is told to stop."""

    echo: str
    first: int
    last: int
    cluster: int
    begins: int  # when the next scan that is not built yet does
    lasts: int  # nanoseconds of a scan
    every: int = 1
    left: int = 0  # scans that are still to come; 0: it does not end


class SimulatedHokuyo(Chassis[Profile, _Stream]):
    """One simulated device; obeys `lidario.sim.device.SimulatedDevice`. The rest as in `Chassis`."""

    def __init__(self, profile: Profile, **making: Unpack[Making]) -> None:
        super().__init__(profile, **making)
        self._queue = TransmitQueue(profile.line)
        serial = making.get("serial")
        number = f"H{self._random.integers(10**7):07}"
        self._serial = number if serial is None else serial.decode("ascii")
        if not re.fullmatch(r"[A-Za-z0-9-]{1,20}", self._serial, re.ASCII):
            raise ValueError("a serial number is 1 to 20 letters and digits")
        self._clock_ns = int(self._random.integers(1 << 24)) * 1_000_000
        self.spin_up_s = 0.05
        self._period = 60_000_000_000 // profile.rpm
        self._step_ns = 60e9 / profile.rpm / profile.turn
        self._begun = b""
        self._adjusting = False
        self._speaks_scip1 = profile.begins_scip1

    def _hear(self, data: bytes, now: int) -> None:
        """Take bytes; a line is obeyed at its end."""
        *lines, rest = (self._begun + data).replace(b"\r", b"\n").split(b"\n")
        self._begun = rest[-_LONGEST_LINE - 1 :]
        for line in lines:
            if line:
                self._consider(line, now)

    def _consider(self, line: bytes, now: int) -> None:
        text = line.decode("latin-1")
        name = _NAMES.get(text[:2], "unknown")
        if now < self._deaf_until:
            why = self._deaf_why
        elif self._speaks_scip1:
            self._speaks_scip1 = text != "SCIP2.0"
            why = "speaks SCIP 1.1" if self._speaks_scip1 else ""
            self._respond(line + (b"\nE\n\n" if why else b"\n0\n\n"), now, name)
        elif not text.isascii() or len(text) > _LONGEST_LINE or text[:2] not in _NAMES:
            why = "unknown to this device"
            self._respond(pack_status(line, b"0E"), now, name)
        elif self._adjusting and text not in ("TM1", "TM2", "QT", "RS"):
            why = "while its clock is adjusted"
            self._respond(pack_status(line, b"0E"), now, name)
        else:
            why = self._obey(text[:2], text, now)
        self.log.add(now, name, line + b"\n", why)

    def _obey(self, word: str, text: str, now: int) -> str:
        """Do what is asked, and respond; why not, in the words of the log."""
        echo, tell = text.encode("ascii"), self._texts(now).get(text)
        if tell is not None:
            lines = pack_lines(echo, tell, counts_semicolon=self.profile.counts_semicolon)
            self._respond(self._garbled(lines), now, text)
            return ""
        if word in ("MD", "ME", "GD", "GE"):
            return self._measure(text, now)
        told = {"%ST": sealed(self._state().encode()), "TM1": pack_clock(self._clock(now))}.get(text)
        if told is not None:
            self._respond(echo + b"\n" + sealed(b"00") + told + b"\n", now, text)
            return ""
        status = _STATUSES.get(text, "0F" if word == "SS" else "0E")
        if text == "QT":
            self.halt(now)
        elif text == "RS":
            self._reset(now)
        elif text == "BM":
            status = self._laser_on(now)
        elif text in ("TM0", "TM2"):
            status = self._adjust(begins=text == "TM0")
        self._respond(pack_status(echo, status.encode()), now, text)
        return "" if status in ("00", "02", "03") else f"refused with status {status}"

    def _texts(self, now: int) -> dict[str, list[str]]:
        """The lines of each response that consists of them, by its request."""
        of = self.profile
        state = f"Trouble!! Error No. =[00->{self.health[1]:02}]" if self.health[0] else of.well
        return {
            "VV": [
                "VEND:Hokuyo Automatic Co.,Ltd.", f"PROD:{of.told[0]}", f"FIRM:{of.told[1]}", "PROT:SCIP 2.0",
                f"SERI:{self._serial}",
            ],
            "PP": [
                f"MODL:{of.product}(Hokuyo Automatic Co.,Ltd.)", f"DMIN:{of.reach_mm[0]}", f"DMAX:{of.reach_mm[1]}",
                f"ARES:{of.turn}", f"AMIN:{of.span[0]}", f"AMAX:{of.span[1]}", f"AFRT:{of.front}", f"SCAN:{of.rpm}",
            ],
            "II": [
                f"MODL:{of.product}", f"LASR:{'ON' if self.motor_on else 'OFF'}", f"SCSP:{of.rpm}",
                f"MESM:{'Measuring' if self.scanning else 'Idle'}", "SBPS:USB 2.0", f"TIME:{self._clock(now):06X}",
                f"STAT:{state}",
            ],
        }  # fmt: skip

    def _measure(self, text: str, now: int) -> str:
        found = _MEASURE.fullmatch(text) or _ONCE.fullmatch(text)
        word, status = text[:2], "00"
        if word[1] == "E" and not self.profile.intensity:
            status = "0E"
        elif found is None:
            length = 15 if word[0] == "M" else 12
            status = "0H" if len(text) == length else "0D" if len(text) > length else "0C"
        elif self.health[0]:
            status = "50"
        elif int(found[2]) > int(found[3]):
            status = "05"
        elif not self.profile.span[0] <= int(found[2]) <= int(found[3]) <= self.profile.span[1]:
            status = "04"
        elif word[0] == "G" and not self.motor_on:
            status = "10"
        if status != "00" or found is None:
            self._respond(pack_status(text.encode(), status.encode()), now, text)
            return "unknown to this device" if status == "0E" else f"refused with status {status}"
        self._end_stream(now)
        if word[0] == "M":
            self._laser_on(now)
            self._respond(pack_status(text.encode(), b"00"), now, text)
        origin = max(self._response_at(now), self.motor.stable_at or 0)
        first, last, cluster = int(found[2]), int(found[3]), max(int(found[4]), 1)
        stream = _Stream(text, first, last, cluster, origin, round((last - first + 1) * self._step_ns))
        if word[0] == "G":
            self._respond(self._block(stream).replace(b"\n99b\n", b"\n00P\n", 1), origin, text)
        else:
            stream.every, stream.left = int(found[5]) + 1, int(found[6])
            self._stream = stream
        return ""

    def _state(self) -> str:
        if self.health[0]:
            return "900"
        return "002" if self._adjusting else "004" if self.scanning else "003" if self.motor_on else "000"

    def _laser_on(self, now: int) -> str:
        if self.health[0]:
            return "01"
        if self.motor_on:
            return "02"
        self.motor.set_rpm(self.profile.rpm, now)
        return "00"

    def _adjust(self, *, begins: bool) -> str:
        if begins == self._adjusting:
            return "02" if begins else "03"
        if begins and self.motor_on:
            return "10"
        self._adjusting = begins
        return "00"

    def _clock(self, now: int) -> int:
        return (now + self._clock_ns) // 1_000_000 % (1 << 24)

    def _due(self, stream: _Stream) -> int:
        return stream.begins + stream.lasts

    def _advance(self, now: int) -> None:
        self._now = now = max(self._now, now)
        while (stream := self._stream) is not None and self._due(stream) <= now:
            self._queue.push(self._block(stream), self._due(stream))
            stream.begins += stream.every * self._period
            if stream.left:
                stream.left -= 1
                self._stream = stream if stream.left else None

    def _block(self, stream: _Stream) -> bytes:
        of = self.profile
        steps = np.arange(stream.first, stream.last + 1)
        times = stream.begins + (steps - stream.first).astype(np.float64) * self._step_ns
        mm = self._world.ranges_mm((of.front - steps).astype(np.float64) * (360.0 / of.turn), times * 1e-9)
        mm = np.where((mm < of.reach_mm[0]) | (mm > of.reach_mm[1]), of.nothing, np.rint(mm))
        strength = np.where((mm >= of.reach_mm[0]) & (mm <= of.reach_mm[1]), np.clip(4000 - mm / 10, 200, 4000), 0)
        values = self._joined(mm, stream.cluster)
        if stream.echo[1] == "E":
            values = np.stack((values, self._joined(strength, stream.cluster)), axis=1).ravel()
        echo = stream.echo if stream.echo[0] == "G" else f"{stream.echo[:-2]}{max(stream.left - 1, 0):02}"
        return pack_block(echo.encode(), self._clock(stream.begins), values)

    @staticmethod
    def _joined(numbers: npt.NDArray[np.float64], cluster: int) -> npt.NDArray[np.int64]:
        whole = numbers.astype(np.int64)
        return whole if cluster == 1 else np.minimum.reduceat(whole, np.arange(0, len(whole), cluster))

    def _restart(self, now: int, up: int) -> None:
        super()._restart(now, up)
        self._begun, self._adjusting, self._speaks_scip1 = b"", False, self.profile.begins_scip1


make_simulated: Maker[SimulatedHokuyo] = maker(SimulatedHokuyo, PROFILES)


def sealed(text: bytes) -> bytes:
    """A line with its check character and its end."""
    return text + bytes((sum(text) % 64 + 48,)) + b"\n"


def pack_status(echo: bytes, status: bytes) -> bytes:
    """A response that is a status alone."""
    return echo + b"\n" + sealed(status) + b"\n"


def pack_lines(echo: bytes, lines: Sequence[str], *, counts_semicolon: bool) -> bytes:
    """A response of lines such as ``MODL:URG-04LX``; the ``;`` behind each belongs to its sum or does not."""
    written = b""
    for line in lines:
        text = line.encode("ascii")
        written += sealed(text + b";") if counts_semicolon else text + b";" + sealed(text)[-2:]
    return echo + b"\n" + sealed(b"00") + written + b"\n"


def pack_block(echo: bytes, milliseconds: int, numbers: npt.NDArray[np.int64]) -> bytes:
    """One scan; `echo` is the request, with the scans that are still to come at its end."""
    text = encoded(numbers, 3)
    lines = [sealed(text[at : at + _LINE]) for at in range(0, len(text), _LINE)]
    return echo + b"\n" + sealed(b"99") + pack_clock(milliseconds) + b"".join(lines) + b"\n"


def pack_clock(milliseconds: int) -> bytes:
    """The line that tells the clock."""
    return sealed(encoded(np.array([milliseconds]), 4))


def encoded(numbers: npt.NDArray[np.int64], width: int) -> bytes:
    """Numbers as so many characters each, of six bits, the most significant first."""
    digits = [numbers // 64 ** (width - 1 - place) % 64 + 48 for place in range(width)]
    return bytes(np.stack(digits, axis=1).astype(np.uint8).ravel())
