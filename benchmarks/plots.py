"""Draws the plots, in the environment of the other drivers, where matplotlib is."""

from __future__ import annotations

import subprocess
from pathlib import Path

from benchmarks.peers import Peers
from benchmarks.processes import ROOT

FOLDER = ROOT / "benchmarks" / "plots"


def draw(results: Path, peers: Peers) -> str:
    """Draw what `results` holds into `benchmarks/plots`; what came of it, in words."""
    FOLDER.mkdir(exist_ok=True)
    why = peers.why_absent("matplotlib")
    if why:
        return f"no plots: {why}"
    done = subprocess.run(
        peers.command("draw", str(results.resolve()), str(FOLDER)),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        return f"no plots: {(done.stderr.strip().splitlines() or ['it failed'])[-1]}"
    return f"plots: {', '.join(done.stdout.split())}"
