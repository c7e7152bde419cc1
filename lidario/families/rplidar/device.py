"""One RPLIDAR: what its responses mean, and how it is started.

Payloads: S-series interface manual, responses to GET_INFO, GET_HEALTH, GET_SAMPLERATE and GET_LIDAR_CONF. Model
numbers, and the first firmware with GET_LIDAR_CONF (1.24): vendor's SDK 2.1.0. Scan mode ids differ from model to
model, so they are never assumed if the firmware can be asked for them. The motor is in `motor`.
"""

import math
import struct
from dataclasses import replace
from typing import Final

from lidario.basics.model import DeviceInfo, Health, NetworkAddress, SampleRate, ScanMode
from lidario.errors import RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Script, Stream
from lidario.families.rplidar import commands
from lidario.families.rplidar.commands import Conf
from lidario.families.rplidar.configuration import ask_address, set_address
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.motor import MotorDriven
from lidario.families.rplidar.speed import change_speed
from lidario.families.scripts import agreed, health_of
from lidario.wire.envelope import Request

SERIES: Final = ((12, "M"), (9, "T"), (6, "S"), (4, "C"), (1, "A"))  # (first major number, letter), highest first
FIRST_DIRECT_TOF: Final = 4
S2_MAJOR: Final = 7
CONF_FIRMWARE: Final = (1, 24)
SPEED_FIRMWARE: Final = (1, 30)
SAMPLERATE_FIRMWARE: Final = (1, 17)
LEGACY_SAMPLE_US: Final = 476.0  # for firmware too old to be asked (SDK)
LEGACY_MAX_DISTANCE: Final = 16.0
SPIN_UP_S: Final = 5.0
SLOWEST_TURN_S: Final = 1.0
NODE_TYPE: Final = 0x81
EXPRESS_TYPE: Final = 0x82
HQ_TYPE: Final = 0x83
ULTRA_TYPE: Final = 0x84
LEGACY_EXPRESS: Final = ScanMode(0, "Legacy express", 0.0, 0.0, EXPRESS_TYPE)
"""Working mode 0 (S-series interface manual, EXPRESS_SCAN). No document says how far it measures. A C1 and an S1
respond with 0x85."""
HQ_SCAN: Final = ScanMode(0, "HQ scan", 0.0, 0.0, HQ_TYPE)
"""HQ_SCAN, which the vendor's SDK defines but never sends. No document says which devices know it."""


class RplidarDevice(MotorDriven):
    """An RPLIDAR of any series that sends one of the six known formats."""

    fill: Request = commands.FILL
    questions: tuple[Request, ...] = (commands.GET_HEALTH, commands.GET_INFO)

    def __init__(self) -> None:
        super().__init__()
        self._firmware: tuple[int, int] = (0, 0)
        self._is_ethernet = False
        # The mode that was started last, and whether its stream may have been announced without packets.
        self._mode: ScanMode | None = None
        self._may_be_silent = False

    def stop(self) -> Request:
        return commands.STOP

    def halt(self) -> tuple[Request, ...]:
        # The motor first, since the device hears nothing for 10 ms after STOP.
        return (self._halt_motor(), commands.STOP)

    def halt_unknown(self) -> tuple[Request, ...]:
        # The first stops an A2 or A3. The second stops an A1 and makes the others deaf.
        return () if self._major else (commands.motor_pwm(0), commands.DTR_STOPS)

    def reset(self) -> Request:
        return commands.RESET

    def identify(self) -> Script[DeviceInfo]:
        model, minor, major, hardware, serial = struct.unpack("<BBBB16s", (yield from agreed(commands.GET_INFO)))
        self._be_of(model >> 4)
        self._firmware = major, minor
        self._configuration.known = self._major >= FIRST_DIRECT_TOF or self._firmware >= CONF_FIRMWARE
        # Each time until it says that it is one: a response may be lost.
        if self.baudrate == 0 and self._major == S2_MAJOR and not self._is_ethernet:
            self._is_ethernet = yield from self._has_mac()
        return DeviceInfo(
            family="rplidar",
            model="RPLIDAR S2E" if self._is_ethernet else _model_name(model),
            model_id=model,
            firmware=f"{major}.{minor:02d}",
            hardware=hardware,
            serial=serial.hex().upper(),
        )

    def health(self) -> Script[Health]:
        return (yield from health_of(commands.GET_HEALTH, (yield commands.GET_HEALTH)))

    def sample_rate(self) -> Script[SampleRate]:
        if self._major < FIRST_DIRECT_TOF and self._firmware < SAMPLERATE_FIRMWARE:
            return SampleRate(LEGACY_SAMPLE_US, LEGACY_SAMPLE_US)
        standard, express = struct.unpack("<HH", (yield from agreed(commands.GET_SAMPLERATE)))
        return SampleRate(float(standard), float(express))

    def modes(self) -> Script[tuple[ScanMode, ...]]:
        """As `Device.modes`: the device's own list, or the modes that old firmware is known to have.

        A device that is silent about its modes is asked four times, which takes 4 s, and then no more.
        """
        modes: tuple[ScanMode, ...] = ()
        if self._configuration.known:
            modes, note = yield from self._configuration.modes()
            self.modes_note: str = note
        return modes or (yield from self._legacy_modes())

    def load(self, mode: ScanMode) -> float:
        wire = FORMATS.get(mode.response_type)
        return math.nan if wire is None else mode.samples_per_second * wire.longest / wire.samples

    def unlisted_modes(self) -> tuple[ScanMode, ...]:
        """As `Device.unlisted_modes`: the legacy express scan and HQ_SCAN, for firmware that lists its modes.

        Older firmware has the first as its mode "Express". A device that lacks a mode may send something else: the
        descriptor decides.
        """
        return (LEGACY_EXPRESS, HQ_SCAN) if self._configuration.known else ()

    def start(self, mode: ScanMode, *, force: bool = False) -> Script[Stream]:
        """As `Device.start`; the descriptor decides which format is decoded, not the list of modes."""
        if mode.response_type not in FORMATS:
            known = ", ".join(f"0x{number:02X}" for number in sorted(FORMATS))
            raise Unsupported(
                f"scan mode {mode.name!r} sends response type 0x{mode.response_type:02X}; lidario knows {known}"
            )
        if force and mode.response_type != NODE_TYPE:
            raise Unsupported(f"only a plain mode (response type 0x81) can be forced, and {mode.name!r} is none")
        sample_us = mode.sample_us or (yield from self._sample_us(mode))
        before, self._mode = self._mode, mode
        if before is not None and before != mode:
            self._may_be_silent = before.response_type == mode.response_type == ULTRA_TYPE
        yield from self._start_motor()
        stream = FORMATS[mode.response_type]()
        if mode.response_type == NODE_TYPE:
            request = commands.scan(stream, force=force)
        elif mode == HQ_SCAN:
            request = commands.hq_scan(stream)
        else:
            # Firmware that cannot list its modes has no mode numbers: there 0 is the express scan (SDK).
            request = commands.express_scan(mode.id if self._configuration.known else 0, stream)
        announced = yield request
        if announced and announced[0] != mode.response_type:
            # The told sample time was for another format, so it is measured from the stream.
            sample_us = 0.0
            mode = replace(mode, response_type=announced[0], sample_us=sample_us)
            stream = next(each for each in request.others if each.response_type == mode.response_type)
        return Stream(
            format=stream,
            decoder=DECODERS[mode.response_type](),
            mode=mode,
            sample_ns=sample_us * 1e3,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=SLOWEST_TURN_S,
        )

    def explain_silence(self, lasted_s: float) -> Script[bool]:
        """As `Device.explain_silence`: if one mode in 0x84 follows another, a start without packets is tried again.

        An A1 announced two of eleven such streams in Stability and sent nothing (cpane/heron, firmware 1.29).
        """
        again, self._may_be_silent = self._may_be_silent and not lasted_s, False
        return (yield from super().explain_silence(lasted_s)) or again

    def network_address(self) -> Script[NetworkAddress]:
        return ask_address()

    def set_network_address(self, address: NetworkAddress) -> Script[None]:
        return set_address(address)

    def set_baudrate(self, baudrate: int, present: int) -> Script[None]:
        if self._major < FIRST_DIRECT_TOF and self._firmware < SPEED_FIRMWARE:
            raise Unsupported("the firmware of this device is too old to change the speed of its line")
        return change_speed(baudrate, present)

    def _has_mac(self) -> Script[bool]:
        """Whether it has an Ethernet address: only this distinguishes an S2E from an S2 (SDK 2.1.0)."""
        try:
            return len((yield _GET_MAC)) > 4
        except ResponseTimeout:
            return False

    def _legacy_modes(self) -> Script[tuple[ScanMode, ...]]:
        rate = yield from self._rate()
        standard = ScanMode(0, "Standard", rate.standard_us, LEGACY_MAX_DISTANCE, NODE_TYPE, typical=True)
        if self._major >= FIRST_DIRECT_TOF or self._firmware < SAMPLERATE_FIRMWARE:
            return (standard,)
        # Firmware that knows mode ids but lists none (an A2M6) gets the legacy express scan: working mode 0.
        number = 0 if self._configuration.known else 1
        express = ScanMode(number, "Express", rate.express_us, LEGACY_MAX_DISTANCE, EXPRESS_TYPE, typical=True)
        return (replace(standard, typical=False), express)

    def _sample_us(self, mode: ScanMode) -> Script[float]:
        """For a mode that claims 0 µs a sample, ask the older way; if 0 again, it is measured from the stream."""
        if mode == HQ_SCAN:
            return 0.0
        rate = yield from self._rate()
        return rate.standard_us if mode.response_type == NODE_TYPE else rate.express_us

    def _rate(self) -> Script[SampleRate]:
        """As `sample_rate`; zeros if the device does not tell it."""
        try:
            return (yield from self.sample_rate())
        except (ResponseTimeout, RemoteProtocolError):
            return SampleRate(0.0, 0.0)


_GET_MAC: Final = replace(commands.get_lidar_conf(Conf.MAC_ADDRESS), timeout=0.25, attempts=1)
"""An S2 behind a serial-to-network bridge is silent."""


def _model_name(model: int) -> str:
    major, sub = model >> 4, model & 0xF
    for first, letter in SERIES:
        if major >= first:
            return f"RPLIDAR {letter}{major - first + 1}M{sub}"
    return f"RPLIDAR (model 0x{model:02X})"
