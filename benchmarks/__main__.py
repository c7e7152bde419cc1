"""Runs the benchmarks and prints what they found: ``make bench``, or ``python -m benchmarks --help``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import (
    blocked,
    damage,
    decode,
    export,
    faults,
    filters,
    flatout,
    garbage,
    latency,
    live,
    memory,
    publish,
    reaction,
    readme,
    recovery,
    rides,
    scale,
    stages,
    start,
    truth,
    vendor,
    view,
)
from benchmarks.compare import write_rows
from benchmarks.peers import set_up
from benchmarks.plots import draw
from benchmarks.processes import ROOT
from benchmarks.report import Result, Setting, machine

BENCHMARKS: dict[str, Callable[[Setting], Result]] = {
    "decode": decode.run,
    "export": export.run,
    "stages": stages.run,
    "flatout": flatout.run,
    "live": live.run,
    "latency": latency.run,
    "reaction": reaction.run,
    "scale": scale.run,
    "blocked": blocked.run,
    "memory": memory.run,
    "start": start.run,
    "vendor": vendor.run,
    "faults": faults.run,
    "damage": damage.run,
    "truth": truth.run,
    "recovery": recovery.run,
    "rides": rides.run,
    "garbage": garbage.run,
    "view": view.run,
    "publish": publish.run,
    "filters": filters.run,
}
_RESULTS = ROOT / "benchmarks" / "results"


def main(arguments: list[str] | None = None) -> int:
    """Run what was asked for."""
    options = parser().parse_args(arguments)
    names = options.only.split(",") if options.only else list(BENCHMARKS)
    unknown = sorted(set(names) - set(BENCHMARKS))
    if unknown:
        print(f"there is no benchmark {unknown[0]!r}; there are {', '.join(BENCHMARKS)}", file=sys.stderr)
        return 2
    command = " ".join(("python -m benchmarks", *(sys.argv[1:] if arguments is None else arguments)))
    peers = None if options.no_peers else set_up()
    setting = Setting(options.quick, peers, tuple(options.select.split(",")) if options.select else ())
    about = machine() | {"command": command}
    began = time.monotonic()
    results = [BENCHMARKS[name](setting) for name in names]
    about["took"] = f"{time.monotonic() - began:.0f} s"
    text = _text(about, results, [] if peers is None else [f"{p.name} {p.version}" for p in peers.all])
    print(text)
    path = options.json or _RESULTS / ("quick.json" if options.quick else "latest.json")
    _write(path, about, results)
    print(f"every value: {path}", file=sys.stderr)
    if options.rows is not None:
        write_rows(options.rows, about["revision"], {result.name: result.rows for result in results})
    if options.plots and peers is not None:
        print(draw(path, peers), file=sys.stderr)
    if options.readme and names == ["faults"]:
        readme.insert_faults(results[0].tables)
    elif options.readme:
        readme.insert(text)
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of the command."""
    made = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    made.add_argument("--quick", action="store_true", help="only so long that everything is seen to work")
    made.add_argument("--only", metavar="NAMES", help=f"some of {','.join(BENCHMARKS)}")
    made.add_argument("--no-peers", action="store_true", help="lidario alone; nothing is installed")
    made.add_argument("--json", type=Path, metavar="FILE", help="where every value goes")
    made.add_argument("--select", metavar="WORDS", help="only rows that have all of these words (truth, damage)")
    made.add_argument("--rows", type=Path, metavar="FILE", help="where rows go that two commits can be compared by")
    made.add_argument("--plots", action="store_true", help="draw benchmarks/plots/*.svg from it")
    made.add_argument(
        "--readme",
        action="store_true",
        help="put the tables into benchmarks/README.md; of `--only faults`, into docs/reliability.md",
    )
    return made


def _text(about: dict[str, str], results: list[Result], peers: list[str]) -> str:
    lines = [f"- {what}: {value}" for what, value in about.items()]
    if peers:
        lines.append(f"- other drivers: {', '.join(peers)}")
    tables = [table.markdown() for result in results for table in result.tables]
    return "\n".join(["", *lines, "", *(f"{table}\n" for table in tables)])


def _write(path: Path, about: dict[str, str], results: list[Result]) -> None:
    whole: dict[str, Any] = {"machine": about, "benchmarks": {result.name: result.data for result in results}}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(_rounded(whole), indent=1) + "\n")


def _rounded(value: Any) -> Any:
    """Six digits are more than any of it is worth."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list) else value


if __name__ == "__main__":
    sys.exit(main())
