"""A simulated RPLIDAR on a bench: requests as bytes, a clock that is moved by hand, and what comes back."""

import struct
from functools import reduce
from operator import xor

from lidario.families.rplidar.simulated import profiles
from lidario.families.rplidar.simulated.device import PROFILES, Mode, make_simulated
from lidario.sim.rooms import make_world
from lidario.sim.world import World
from tests.reference import rplidar

MS = 1_000_000
SECOND = 1_000 * MS
STOP, RESET, SCAN, FORCE_SCAN = b"\xa5\x25", b"\xa5\x40", b"\xa5\x20", b"\xa5\x21"
GET_INFO, GET_HEALTH, GET_SAMPLERATE = b"\xa5\x50", b"\xa5\x52", b"\xa5\x59"
MOTOR_600 = bytes.fromhex("a5 a8 02 58 02 55")
MOTOR_OFF = bytes.fromhex("a5 a8 02 00 00 0f")
BOARD = bytes.fromhex("a5 ff 04 00 00 00 00 5e")
DUTY_660, DUTY_0 = bytes.fromhex("a5 f0 02 94 02 c1"), bytes.fromhex("a5 f0 02 00 00 57")
EXPRESS_1 = bytes.fromhex("a5 82 05 01 00 00 00 00 23")
SOLD = [profile.name for profile in profiles.SOLD]
MODES = [(profile.name, mode.id) for profile in PROFILES.values() for mode in profile.modes]
ONE_A_FORMAT = list(
    {mode.format: (profile.name, mode.id) for profile in PROFILES.values() for mode in profile.modes}.values()
)


def framed(command: int, payload: bytes) -> bytes:
    body = bytes([0xA5, command, len(payload)]) + payload
    return body + bytes([reduce(xor, body)])


def express(mode_id: int) -> bytes:
    return framed(0x82, bytes([mode_id, 0, 0, 0, 0]))


def begin(mode: Mode) -> bytes:
    """What starts a mode: SCAN the plain one, since 0 is the legacy express scan for EXPRESS_SCAN."""
    return SCAN if mode.response_type == 0x81 else express(mode.id)


def conf(kind: int, *mode: int) -> bytes:
    return framed(0x84, struct.pack("<I", kind) + b"".join(struct.pack("<H", m) for m in mode))


class Bench:
    """A device and the time, which begins at 100 s; the motor needs no time unless a test says so."""

    def __init__(
        self, model: str = "rplidar-s2", *, world: World | None = None, spin_up_s: float = 0.0, seed: int = 0
    ) -> None:
        self.device = make_simulated(model, world=world or make_world("circle"), seed=seed)
        self.device.spin_up_s = spin_up_s
        self.now = 100 * SECOND

    def send(self, data: bytes) -> None:
        self.device.receive(data, self.now)

    def run(self, ns: int, step: int = 0) -> bytes:
        """Let time pass, and collect what the device sends meanwhile."""
        end, out = self.now + ns, b""
        while step and self.now + step < end:
            self.now += step
            out += self.device.transmit(self.now)
        self.now = end
        return out + self.device.transmit(end)

    def ask(self, data: bytes, within: int = 20 * MS) -> bytes:
        self.send(data)
        return self.run(within)

    def mode(self, mode_id: int) -> Mode:
        """One that it has."""
        mode = self.device.profile.mode(mode_id)
        assert mode is not None
        return mode

    def begin(self, mode: Mode) -> None:
        """Start a mode, with the motor first where nothing else starts it."""
        if self.device.profile.motor == "pwm":
            self.send(DUTY_660)
        self.send(begin(mode))

    @property
    def why(self) -> str:
        return self.device.log[-1].why


def packets_of(kind: int, stream: bytes) -> list[bytes]:
    """The whole packets of a stream that begins at a packet; the reference refuses damaged ones."""
    return rplidar.split(kind, stream[: len(stream) // rplidar.PACKET_BYTES[kind] * rplidar.PACKET_BYTES[kind]])
