"""Whether the vendor's C++ driver runs on the simulated devices: information, health, its choice of a mode, scans.

The simulated devices are as a real one is only if drivers that were written for the real one work with them. The
driver (`pyrplidarsdk`, the vendor's SDK with a thin wrapper) opens each profile on a pseudo-terminal, in a process
of its own. The rotor stands still when it starts, and the device sees a circle of 2 m.

On the profiles that are sold everything must be right. The other profiles show what the driver makes of a device
that is not as the manual says; there a failure is a finding about the driver.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.processes import Failed, run_json
from benchmarks.report import Result, Setting, Table
from lidario.families.rplidar.simulated.device import PROFILES, SimulatedRplidar
from lidario.sim.device import Received
from lidario.sim.rooms import make_world
from lidario.sim.serve import PtyServer

__all__ = ["Run", "run"]

_PEER = "pyrplidarsdk"
_RADIUS_M = 2.0  # of the world "circle"
_TURN_S = 0.1  # at 600 rpm, which the driver asks for
_MAC = 0x79  # conf type that only Ethernet devices know; the driver asks for it at each start


@dataclass(frozen=True, slots=True)
class Run:
    """One profile in the driver's hands.

    Attributes:
        device: The simulated device, with its log.
        told: What the driver read, as `benchmarks.adapters.vendor` prints it.
        failed: Why there is nothing; empty when there is.
    """

    device: SimulatedRplidar
    told: dict[str, Any]
    failed: str = ""

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
        samples = _TURN_S * 1e9 * mode.packet[1] / mode.period_ns
        # The first scans are partial, or of a rotor that is not yet at its speed.
        points, metres = scans[-1]
        if abs(points - samples) > 0.05 * samples:
            found.append(f"{points} points instead of {samples:.0f}")
        if abs(metres - _RADIUS_M) > 0.01:
            found.append(f"{metres} m instead of {_RADIUS_M} m")
        return found


def run(setting: Setting) -> Result:
    """Every profile; with ``--quick`` those that are sold."""
    table = Table(
        "vendor: the vendor's C++ driver on simulated devices",
        ["profile", "kind", "mode it chose", "first scan, s", "scans", "points", "discarded", "wrong"],
    )
    absent = "left out" if setting.peers is None else setting.peers.why_absent(_PEER)
    if absent:
        table.notes.append(f"{_PEER}: {absent}")
        return Result("vendor", [table], {"absent": absent})
    names = [name for name, profile in PROFILES.items() if profile.kind == "sold" or not setting.quick]
    runs = {}
    for name in names:
        setting.say(f"vendor: {name}")
        runs[name] = _drive(setting, name)
        table.rows.append(_row(name, runs[name]))
    table.notes += [
        "discarded: requests that the device discarded, less the question for an Ethernet address (conf 0x79), to "
        "which a serial device is silent; it costs the driver 0.5 s at each start",
        "wrong: what the driver read wrongly or not at all; on a device that is sold a defect of the simulator",
    ]
    data = {name: {**each.told, "wrong": each.wrong()} for name, each in runs.items()}
    return Result("vendor", [table], data)


def _drive(setting: Setting, name: str) -> Run:
    assert setting.peers is not None
    device = SimulatedRplidar(PROFILES[name], world=make_world("circle"))
    with PtyServer(device, chunk=64) as server:
        task = {"path": server.path, "baudrate": device.baudrate, "scans": 10, "patience_s": 8.0}
        try:
            told = run_json(
                setting.peers.command("vendor"),
                timeout=40.0,
                environment=setting.peers.environment(_PEER),
                given=task,
            )
        except Failed as failed:
            return Run(device, {}, str(failed))
    return Run(device, told)


def _row(name: str, of: Run) -> list[str]:
    scans = of.told.get("scans", [])
    first = of.told.get("first_scan_s")
    return [
        name,
        of.device.profile.kind,
        of.mode,
        "–" if first is None else f"{first:.2f}",
        str(len(scans)),
        str(scans[-1][0]) if scans else "–",
        ", ".join(f"{each.name}: {each.why}" for each in of.discarded) or "none",
        ", ".join(of.wrong()) or "nothing",
    ]


def _asks_for_mac(request: Received) -> bool:
    return request.name == "get_lidar_conf" and request.data[3:7] == _MAC.to_bytes(4, "little")
