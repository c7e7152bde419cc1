"""Exporting a recording: seconds of a core, seconds that pass, and memory, by `lidario export` as a user calls it.

The recording is made of ten seconds of a simulated lidar on a real line, whose bytes are repeated, with their
times, until it is long enough: in memory its reads would be twelve times as many.
"""

from __future__ import annotations

import asyncio
import json
import math
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import lidario
from benchmarks.processes import ROOT
from benchmarks.report import Result, Setting, Table
from lidario.recording.read import McapRecording
from lidario.recording.write import FileWriter

_MODEL = "rplidar-s2"
_SCANS = 100
_PATIENCE_S = 900.0
_FORMS = (".npz", ".mcap")
_CHILD = """
import asyncio
import json, resource, subprocess, sys, time
began = time.monotonic()
done = subprocess.run(sys.argv[1:], capture_output=True, text=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({"code": done.returncode, "said": done.stderr, "passed_s": time.monotonic() - began,
                  "cpu_s": used.ru_utime + used.ru_stime, "rss_mb": used.ru_maxrss / 1024}))
"""
"""One for each figure: the memory that is told is the largest of all children so far."""


def run(setting: Setting) -> Result:
    """An hour of an S2, alone and twice; 20 s where it must be quick."""
    seconds = 20.0 if setting.quick else 3600.0
    found: dict[str, Any] = {}
    table = Table(
        f"export: {seconds:g} s of an S2", ["what", "MB", "core, s", "passed, s", "peak of a process, MB", "scans"]
    )
    with tempfile.TemporaryDirectory() as folder:
        setting.say(f"export: a recording of {seconds:g} s")
        path = Path(folder, "one.mcap")
        make_recording(path, seconds)
        other = Path(folder, "two.mcap")
        other.hardlink_to(path)
        for name, files, jobs, form in (
            *((f"one file to {form}", [path], 1, form) for form in _FORMS),
            ("two files to .npz, -j 1", [path, other], 1, ".npz"),
            ("two files to .npz, -j 2", [path, other], 2, ".npz"),
        ):
            setting.say(f"export: {name}")
            each = found[name] = _export(files, Path(folder, "out-{}" + form), jobs)
            each["mb"] = sum(file.stat().st_size for file in files) / 1e6
            table.add(
                name, f"{each['mb']:.0f}", f"{each['cpu_s']:.1f}", f"{each['passed_s']:.1f}",
                f"{each['rss_mb']:.0f}", str(each["scans"]),
            )  # fmt: skip
            for out in Path(folder).glob("out-*"):
                out.unlink()
    table.notes.append("Start of Python and its imports included. Memory does not grow with the file.")
    return Result("export", [table], found)


def make_recording(path: Path, seconds: float) -> None:
    """A recording of an S2 that is so long: the bytes of some revolutions again and again, with right times."""
    few = path.with_suffix(".few")

    async def record() -> None:
        # In memory a loaded machine loses nothing.
        device = lidario.simulate(_MODEL)
        async with lidario.open_lidar(device) as lidar, lidar.record(few), lidar.scans(depth=_SCANS) as scans:
            for _ in range(_SCANS):
                await anext(scans)

    asyncio.run(record())
    recording = McapRecording(few)
    stream, offset_ns = recording.streams[0], recording.about.clock_offset_ns
    pieces = list(recording.pieces())
    # Whole revolutions, so that the next copy goes on where this one ends.
    revolution = 80 * stream.began.packet_size
    whole = sum(len(piece.data) for piece in pieces) // revolution * revolution
    lasts_ns = round(whole / stream.began.packet_size * 40 * stream.began.sample_ns)
    about = replace(
        recording.about,
        events=(*recording.responses.values(), stream.began),
        received_before=stream.began.at,
    )
    writer = FileWriter(path, about)
    for copy in range(math.ceil(seconds * 1e9 / lasts_ns)):
        left = whole
        for piece in pieces:
            data = piece.data[:left]
            left -= len(data)
            if data:
                writer.add_chunk(piece.at_ns + offset_ns + copy * lasts_ns, False, data)
        writer.flush()
    writer.close()
    few.unlink()


def _export(files: list[Path], out: Path, jobs: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "lidario", "export", *map(str, files), str(out), "-j", str(jobs)]
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, *command],
        cwd=ROOT, capture_output=True, text=True, timeout=_PATIENCE_S, check=True,
    )  # fmt: skip
    found: dict[str, Any] = json.loads(done.stdout)
    if found["code"]:
        raise RuntimeError(f"lidario export failed: {found['said']}")
    found["scans"] = sum(int(line.split()[-2]) for line in found["said"].splitlines() if line.endswith(" scans"))
    return found
