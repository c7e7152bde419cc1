"""Floods from every source, each in processes of its own: ``python -m benchmarks.floods``, or ``make floods``.

For each: how late a ticker of 10 ms was at most, how much of that its own thread can have computed, and by how much
memory grew. Ends with 1 where that thread made it later than 50 ms, or memory grew by more than 60 MB. What else is
late is the machine's: see the first row, where nothing floods.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from typing import Final

from benchmarks.floods.bytes import FLOODS, MODES

MOST_LATE_MS: Final = 50.0
MOST_MB: Final = 60.0
_BOUND_S: Final = 30.0
"""Longest time for all that is not the flood itself."""
_ZENOH: Final = ("scan", "scan-large", "raw-endless", "raw-short", "raw-restarts", "raw-heads", "raw-nodes",
                 "raw-entries", "raw-events", "status", "tokens")  # fmt: skip


def rows() -> list[tuple[str, str]]:
    """Every source with every flood."""
    found = [("tcp", "nothing")]
    found += [(way, kind) for way in ("tcp", "udp", "pty") for kind in FLOODS]
    found += [("udp-tiny", "endless"), ("udp-tiny", "short")]
    return found + [
        (way, kind) for way in ("zenoh", "fleet") for kind in _ZENOH if way == "zenoh" or kind != "tokens"
    ]


def flood(way: str, kind: str, seconds: float, router: str) -> dict[str, float]:
    """One of them; ``late_ms`` is infinite where the event loop never came back."""
    quiet = kind == "nothing"
    attack = [
        sys.executable,
        "-m",
        "benchmarks.floods.attacker",
        way,
        "endless" if quiet else kind,
        str(seconds),
        router,
    ]
    with subprocess.Popen(attack, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as attacker:
        assert attacker.stdin is not None
        assert attacker.stdout is not None
        source = attacker.stdout.readline().strip()
        command = [sys.executable, "-m", "benchmarks.floods.victim", source, str(seconds), MODES.get(kind, "")]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as victim:
            assert victim.stdout is not None
            try:
                if victim.stdout.readline().strip() != "ready":
                    return {"late_ms": float("inf")}
                if not quiet:
                    attacker.stdin.write("\n")
                    attacker.stdin.flush()
                told, _ = victim.communicate(timeout=seconds + _BOUND_S)
                found: dict[str, float] = json.loads(told or '{"late_ms": Infinity}')
            except subprocess.TimeoutExpired:
                found = {"late_ms": float("inf")}
            finally:
                victim.kill()
                attacker.kill()
    return found


def main(arguments: list[str] | None = None) -> int:
    """Flood, and tell."""
    options = _parser().parse_args(arguments)
    chosen = [row for row in rows() if not options.only or options.only in " ".join(row)]
    router, address, bad = None, "-", 0
    if any(way in ("zenoh", "fleet") for way, _ in chosen):
        from tests.support.router import Router

        router = Router()
        address = router.address
    print(f"{'source':9} {'flood':13} {'latest tick':>12} {'computed':>12} {'memory':>10}", flush=True)
    for way, kind in chosen:
        found = flood(way, kind, options.seconds, address)
        late, memory = found.pop("late_ms"), found.pop("memory_mb", float("nan"))
        busy = found.pop("busy_ms", late)
        worse = busy > MOST_LATE_MS or memory > MOST_MB
        bad += worse
        rest = "TOO MUCH " * worse + ", ".join(f"{name} {value:.4g}" for name, value in found.items())
        print(f"{way:9} {kind:13} {late:9.1f} ms {busy:9.1f} ms {memory:7.1f} MB  {rest}", flush=True)
    if router is not None:
        router.stop()
    return 1 if bad else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.floods", description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="how long each takes")
    parser.add_argument("--only", metavar="WORD", help="those with this in their name")
    return parser


if __name__ == "__main__":
    sys.exit(main())
