"""Whether the vendor's C++ driver runs on the simulated devices: information, health, its choice of a mode, scans.

The simulated devices are as a real one is only if drivers that were written for the real one work with them. The
driver (`pyrplidarsdk`, the vendor's SDK with a thin wrapper) opens each profile on a pseudo-terminal, Ethernet
models by UDP, in a process of its own. The rotor stands still when it starts, but that of an A1, whose switch a
pseudo-terminal does not have; the device sees a circle of 2 m. Then lidario opens a device of the same profile in
the same way, as a user would who names nothing but the port.

On the profiles that are sold everything must be right. The other profiles show what the driver makes of a device
that is not as the manual says; there a failure is a finding about the driver.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from statistics import median
from typing import Any

from benchmarks.processes import Failed
from benchmarks.report import Result, Setting, Table
from lidario import LidarError, open_lidar
from lidario.families.rplidar.simulated.device import PROFILES, Mode, Profile, SimulatedRplidar
from lidario.families.rplidar.simulated.profiles import SOLD
from lidario.sim.device import Received
from lidario.sim.rooms import make_world
from lidario.sim.serve import PtyServer, UdpServer

_PEER = "pyrplidarsdk"
_RADIUS_M = 2.0  # of the world "circle"
_PATIENCE_S = 2.0
_MAC = 0x79  # conf type that only Ethernet devices know; the driver asks for it at each start


@dataclass(frozen=True, slots=True)
class Run:
    """One profile in the driver's hands.

    Attributes:
        device: The simulated device, with its log.
        told: What the driver read, as `benchmarks.adapters.vendor` prints it.
        failed: Why there is nothing; empty when there is.
        ours: What was wrong with lidario on the same profile; empty when nothing was.
    """

    device: SimulatedRplidar
    told: dict[str, Any]
    failed: str = ""
    ours: str = ""

    @property
    def mode(self) -> str:
        """Name of the mode that the driver has started."""
        starts = [each for each in self.device.log if each.name in ("scan", "express_scan") and each.obeyed]
        if not starts:
            return "–"
        profile = self.device.profile
        mode = profile.mode(starts[-1].data[3]) if starts[-1].name == "express_scan" else profile.standard
        return "–" if mode is None else mode.name

    @property
    def discarded(self) -> list[Received]:
        """Requests that the device discarded, less the question for an Ethernet address."""
        return [each for each in self.device.log if not each.obeyed and not _asks_for_mac(each)]

    def wrong(self) -> list[str]:
        """What the driver read wrongly or not at all."""
        if self.failed:
            return [self.failed]
        found = []
        info, profile = self.told["info"] or {}, self.device.profile
        major, minor = profile.firmware
        expected = {
            "model": profile.model,
            "firmware_version": major << 8 | minor,
            "hardware_version": profile.hardware,
            "serial_number": self.device.serial.hex(),
        }
        found += [f"{name} {info.get(name)}" for name, value in expected.items() if info.get(name) != value]
        if self.told["health"] != list(self.device.health):
            found.append(f"health {self.told['health']}")
        scans = self.told["scans"]
        if not self.told["started"] or not scans:
            return [*found, "no scan" if self.told["started"] else "scan not started"]
        mode = next(each for each in profile.modes if each.name == self.mode)
        samples = turn_samples(profile, mode)
        # The first scans are partial, or of a rotor that is not yet at its speed.
        count, metres = scans[-1]
        if abs(count - samples) > 0.05 * samples:
            found.append(f"{count} samples instead of {samples:.0f}")
        if abs(metres - _RADIUS_M) > 0.01:
            found.append(f"{metres} m instead of {_RADIUS_M} m")
        return found


def turn_samples(profile: Profile, mode: Mode) -> float:
    """Samples in a revolution at the speed that the driver asks for, or else the motor's own."""
    return 60e9 / profile.own_rpm * mode.packet[1] / mode.period_ns


def run(setting: Setting) -> Result:
    """Every profile; with ``--quick`` those that are sold."""
    table = Table(
        "vendor: the vendor's C++ driver on simulated devices",
        ["profile", "odd", "mode it chose", "first scan, s", "scans", "samples", "discarded", "wrong", "lidario"],
    )
    absent = "left out" if setting.peers is None else setting.peers.why_absent(_PEER)
    if absent:
        table.notes.append(f"{_PEER}: {absent}")
        return Result("vendor", [table], {"absent": absent})
    names = [profile.name for profile in SOLD] if setting.quick else [*PROFILES]
    runs = {}
    for name in names:
        setting.say(f"vendor: {name}")
        runs[name] = _drive(setting, name)
        table.add(*_row(name, runs[name]))
    table.notes += [
        "discarded: requests that the device discarded, less the question for an Ethernet address (conf 0x79), to "
        "which a serial device is silent; it costs the driver 0.5 s at each start",
        "wrong: what the driver read wrongly or not at all; on a device that is sold a defect of the simulator",
        "lidario: what lidario read wrongly on the same profile, or that nothing was wrong",
    ]
    data = {name: {**each.told, "wrong": each.wrong(), "ours": each.ours} for name, each in runs.items()}
    return Result("vendor", [table], data)


def _drive(setting: Setting, name: str) -> Run:
    device = SimulatedRplidar(PROFILES[name], world=make_world("circle"))
    with _served(device) as server:
        task: dict[str, Any] = {"baudrate": device.baudrate, "scans": 10, "patience_s": 8.0}
        if isinstance(server, PtyServer):
            task["path"] = server.path
        else:
            task["host"], task["port"] = server.address
        try:
            told = setting.ask_peer(_PEER, "vendor", task, timeout=40.0)
        except Failed as failed:
            return Run(device, {}, str(failed), _ours(name))
    return Run(device, told, ours=_ours(name))


def _served(device: SimulatedRplidar) -> PtyServer | UdpServer:
    return UdpServer(device) if device.is_network else PtyServer(device, chunk=64)


def _ours(name: str) -> str:
    """What lidario reads wrongly on the same profile."""
    device = SimulatedRplidar(PROFILES[name], world=make_world("circle"))
    with _served(device) as server:
        path = server.path if isinstance(server, PtyServer) else "udp://{}:{}".format(*server.address)
        try:
            wrong = asyncio.run(_read(path, device))
        except LidarError as error:
            wrong = [f"{type(error).__name__}: {error}".partition("\n")[0]]
        stopped = device.profile.motor in ("rpm", "pwm")
        end = time.monotonic() + _PATIENCE_S
        while (moving := device.scanning or (device.motor_on and stopped)) and time.monotonic() < end:
            time.sleep(0.01)  # the thread of the server reads the last requests
    return ", ".join([*wrong, "not left still"] if moving else wrong)


async def _read(path: str, device: SimulatedRplidar) -> list[str]:
    found = []
    async with open_lidar(path) as lidar:
        info, health, modes = lidar.info, lidar.health, await lidar.get_modes()
        if (info.model_id, info.serial) != (device.profile.model, device.serial.hex().upper()):
            found.append(f"info {info}")
        if not health.ok:
            found.append(f"health {health}")
        scans = []
        async with lidar.scans() as stream:
            async for scan in stream:
                scans.append(scan)
                if len(scans) == 5:
                    break
        typical = next(mode for mode in modes if mode.typical)
        same = [mode for mode in device.profile.modes if mode.name == typical.name]
        samples = turn_samples(device.profile, same[0]) if same else 0.0
        last = scans[-1]
        if abs(len(last) - samples) > 0.05 * samples:
            found.append(f"{len(last)} samples instead of {samples:.0f}")
        metres = float(median(last.ranges))
        if abs(metres - _RADIUS_M) > 0.01:
            found.append(f"{metres} m instead of {_RADIUS_M} m")
    return found


def _row(name: str, of: Run) -> list[str]:
    scans = of.told.get("scans", [])
    first = of.told.get("first_scan_s")
    return [
        name,
        of.device.profile.oddity or "–",
        of.mode,
        "–" if first is None else f"{first:.2f}",
        str(len(scans)),
        str(scans[-1][0]) if scans else "–",
        ", ".join(f"{each.name}: {each.why}" for each in of.discarded) or "none",
        ", ".join(of.wrong()) or "nothing",
        of.ours or "nothing wrong",
    ]


def _asks_for_mac(request: Received) -> bool:
    return request.name == "get_lidar_conf" and request.data[3:7] == _MAC.to_bytes(4, "little")
