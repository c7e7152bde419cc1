"""The vendor's C++ driver asked for all that it offers: information, health and scans, as JSON on the last line.

It runs in a process of its own, since some devices make the driver crash.
"""

from __future__ import annotations

import time
from statistics import median
from typing import Any

from benchmarks.adapters.process import respond


def main(task: dict[str, Any]) -> dict[str, Any]:
    """Open ``path`` at ``baudrate``, or ``host`` and ``port``; read ``scans`` scans, for ``patience_s`` at most."""
    from pyrplidarsdk import RplidarDriver

    if "path" in task:
        driver = RplidarDriver(port=task["path"], baudrate=task["baudrate"])
    else:
        driver = RplidarDriver(ip_address=task["host"], udp_port=task["port"])
    began = time.monotonic()
    found: dict[str, Any] = {"connected": driver.connect()}
    info, health = driver.get_device_info(), driver.get_health()
    names = ("model", "firmware_version", "hardware_version", "serial_number")
    found["info"] = None if info is None else {name: getattr(info, name) for name in names}
    found["health"] = None if health is None else [health.status, health.error_code]
    found["started"] = driver.start_scan()
    scans: list[tuple[int, float]] = []
    found["scans"] = scans
    end = time.monotonic() + task["patience_s"]
    while found["started"] and len(scans) < task["scans"] and time.monotonic() < end:
        scan = driver.get_scan_data()
        if scan is None:
            time.sleep(0.002)
            continue
        found.setdefault("first_scan_s", time.monotonic() - began)
        scans.append((len(scan[1]), median(scan[1]) if scan[1] else 0.0))
    driver.stop_scan()
    driver.disconnect()
    return found


if __name__ == "__main__":
    respond(main)
