"""Is this code slower than that of another commit? Both in one run, by turns: ``python -m benchmarks.paired``.

On a shared machine two runs of one program differ by more than most changes do. So the other commit is checked out
beside this one for as long as it takes, and the two run by turns, a fraction of a second each; what is compared is
the CPU time, and of all rounds the median of the ratios. Two equal commits differ by up to 0.03.

In memory ("decode") two processes decode the same streams, in chunks of four sizes and as whole files, as
`lidario.decode_file` does. Live, one after the other reads a device that is played on a pseudo-terminal.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.contest import late_by, lost_scans
from benchmarks.processes import ROOT, Failed, Player, Responder, run_json
from benchmarks.report import Table, machine, median, percentile
from benchmarks.streams import KINDS, LIVE, RATES, capture

WHOLE = 0  # instead of a chunk: a file
CHUNKS = (64, 1024, 4096, 65536, WHOLE)
"""Bytes at a time; 65536 are as many as `Link` parses at once."""
_STREAM_S = 6.0
"""So long that the first revolution, from which a decoder learns, weighs little: a scanner turns for hours."""
_SHORT_STREAM_S = 0.6
"""Small chunks take long, so they get less of the stream."""
_FILE_S = 30.0
_PASSES = 2
_LATENCY_S = 0.005
_SETTLE_S = 0.5
_GIT_S = 60.0


class Refused(Exception):
    """There is nothing to compare with; the text says why, in one sentence."""


@dataclass(frozen=True, slots=True)
class Checkout:
    """One of the two.

    Attributes:
        name: For tables.
        root: Its folder.
    """

    name: str
    root: Path

    @property
    def environment(self) -> dict[str, str]:
        """That of its processes: its own code comes first."""
        return os.environ | {"PYTHONPATH": str(self.root)}


class _Decoding(Responder):
    """A process that decodes with the code of one checkout (`benchmarks.paired_worker`)."""

    def __init__(self, checkout: Checkout) -> None:
        self._name = checkout.name
        # -P: the folder of the script holds modules of this checkout.
        command = [sys.executable, "-P", str(ROOT / "benchmarks" / "paired_worker.py")]
        super().__init__(command, checkout.root, checkout.environment)

    def seconds(self, kind: str, path: Path, chunk: int, stream_s: float) -> float:
        """The least CPU time of a few passes over a stream."""
        task = {"kind": kind, "path": str(path), "chunk": chunk, "seconds": stream_s, "passes": _PASSES}
        try:
            least: float = min(self.ask(json.dumps(task))["seconds"])
        except Failed as failed:
            raise Refused(f"{self._name} cannot decode {kind}: {failed}") from None
        return least


@contextmanager
def checked_out(commit: str, root: Path = ROOT) -> Iterator[Checkout]:
    """Another commit of this repository, in a folder that is removed at the end.

    Raises:
        Refused: There is no git, this is no repository, or it has no such commit.
    """
    if shutil.which("git") is None:
        raise Refused("git is not installed, and only git has the code of another commit")
    if _git(root, "rev-parse", "--git-dir").returncode:
        raise Refused(f"{root} is no git repository, so there is no other commit to compare with")
    found = _git(root, "rev-parse", "--verify", "--quiet", "--short", commit + "^{commit}")
    if found.returncode:
        raise Refused(f"there is no commit {commit!r} in {root}")
    with tempfile.TemporaryDirectory() as folder:
        beside = Path(folder) / "other"
        made = _git(root, "worktree", "add", "--detach", str(beside), commit)
        try:
            if made.returncode:
                raise Refused(f"git could not check out {commit!r}: {made.stderr.strip().splitlines()[-1]}")
            yield Checkout(found.stdout.strip(), beside)
        finally:
            _git(root, "worktree", "remove", "--force", str(beside))


def _git(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=_GIT_S, check=False
    )


def compare_decode(
    old: Checkout, new: Checkout, rounds: int, kinds: Sequence[str] = tuple(KINDS), chunks: Sequence[int] = CHUNKS
) -> Table:
    """How long decoding takes, new to old, of each format in chunks of each size."""
    found: dict[tuple[str, int], list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        before, after = (stack.enter_context(_Decoding(each)) for each in (old, new))
        streams: dict[tuple[str, float], Path] = {}
        for kind in kinds:
            for stream_s in set(map(_stream_s, chunks)):
                path = streams[kind, stream_s] = Path(folder) / f"{kind}-{stream_s:g}.bin"
                path.write_bytes(capture(KINDS[kind], stream_s))
        for number in range(rounds + 1):
            for kind in kinds:
                for chunk in chunks:
                    stream_s = _stream_s(chunk)
                    task = (kind, streams[kind, stream_s], chunk, stream_s)
                    took = dict[bool, float]()
                    for which in (False, True) if number % 2 else (True, False):
                        took[which] = (after if which else before).seconds(*task)
                    if number:  # the first round warms up
                        found.setdefault((kind, chunk), []).append((took[False], took[True]))
    table = Table(
        f"paired: decoding, CPU time of {new.name} to that of {old.name}",
        ["format, chunk of", *(f"{chunk} B" if chunk else "a whole file" for chunk in chunks)],
    )
    for kind in kinds:
        table.add(kind, *(_ratio(found[kind, chunk]) for chunk in chunks))
    table.notes.append(f"median of the ratios of {rounds} rounds, and the ratio of the least times")
    return table


def _stream_s(chunk: int) -> float:
    """Seconds of the stream that is decoded in chunks of this size."""
    return {CHUNKS[0]: _SHORT_STREAM_S, WHOLE: _FILE_S}.get(chunk, _STREAM_S)


def _ratio(pairs: Sequence[tuple[float, float]]) -> str:
    """Of pairs (old, new)."""
    least = min(new for _, new in pairs) / min(old for old, _ in pairs)
    return f"{median([new / old for old, new in pairs]):.2f}, {least:.2f}"


def compare_live(old: Checkout, new: Checkout, rounds: int, window_s: float) -> Table:
    """What reading costs and how late scans are, of both, for each device."""
    table = Table(
        f"paired: reading live at {_LATENCY_S * 1e3:g} ms, {new.name} and {old.name}",
        ["device", "CPU, new to old", "CPU, %: old, new", "wake-ups/s", "p50, ms", "p99, ms", "scans lost"],
    )
    for rate in LIVE:
        found: dict[Checkout, list[dict[str, Any]]] = {old: [], new: []}
        with Player(rate) as player:
            for number in range(rounds):
                for each in (old, new) if number % 2 else (new, old):
                    found[each].append(_read(each, rate, player, window_s))
        table.add(*live_row(rate, found[old], found[new]))
    table.notes.append(
        f"each {rounds} times for {window_s:g} s, by turns; pairs are old, new; medians, delays of all scans"
    )
    return table


def _read(checkout: Checkout, rate: str, player: Player, window_s: float) -> dict[str, Any]:
    if not (checkout.root / "benchmarks" / "reader.py").exists():
        raise Refused(f"{checkout.name} cannot read {rate}: it has no benchmarks")
    task = {"paths": player.paths, "baudrate": RATES[rate].baudrate, "family": RATES[rate].kind.family}
    task |= {"latency": _LATENCY_S, "settle_s": _SETTLE_S, "window_s": window_s}
    try:
        got = run_json(
            [sys.executable, "-m", "benchmarks.reader"],
            timeout=window_s + 30.0,
            environment=checkout.environment,
            given=task,
            folder=checkout.root,
        )
    except Failed as failed:
        raise Refused(f"{checkout.name} cannot read {rate}: {failed}") from None
    (arrivals,), played = got["arrivals"], player.report()
    turns = played["turns"][0]
    # The first scans come while the stream starts.
    return got | {"late": late_by(arrivals[5:], turns), "lost": lost_scans(arrivals, turns)}


def live_row(rate: str, old: list[dict[str, Any]], new: list[dict[str, Any]]) -> list[str]:
    def both(digits: int, of: Any) -> str:
        return ", ".join(f"{of(rounds):.{digits}f}" for rounds in (old, new))

    ratios = [after["cpu"] / before["cpu"] for before, after in zip(old, new, strict=True)]
    return [
        rate,
        f"{median(ratios):.2f}",
        both(2, lambda rounds: 100 * median([each["cpu"] for each in rounds])),
        both(0, lambda rounds: median([each["wakeups"] for each in rounds])),
        both(2, lambda rounds: percentile([late for each in rounds for late in each["late"]], 50)),
        both(2, lambda rounds: percentile([late for each in rounds for late in each["late"]], 99)),
        both(0, lambda rounds: sum(each["lost"] for each in rounds)),
    ]


def main(arguments: list[str] | None = None) -> int:
    """Compare; 2 where there is nothing to compare with."""
    options = parser().parse_args(arguments)
    rounds, window_s = (1, 1.0) if options.quick else (options.rounds, 4.0)
    try:
        with checked_out(options.against) as old:
            new = Checkout("this code", ROOT)
            about = machine()
            print(f"- date: {about['date']}\n- revisions: {old.name} and {about['revision']} (this code)\n")
            if options.only != "live":
                print(compare_decode(old, new, rounds, options.kinds or tuple(KINDS)).markdown(), "\n")
            if options.only != "decode":
                print(compare_live(old, new, rounds, window_s).markdown(), "\n")
    except Refused as why:
        print(f"nothing compared: {why}", file=sys.stderr)
        return 2
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of the command."""
    made = argparse.ArgumentParser(prog="python -m benchmarks.paired", description=__doc__)
    made.add_argument("--against", metavar="COMMIT", required=True, help="the other commit, or a branch or tag")
    made.add_argument("--only", choices=("decode", "live"), help="in memory alone, or on a played device alone")
    made.add_argument("--kinds", metavar="KIND", nargs="+", choices=tuple(KINDS), help="decode only these formats")
    made.add_argument("--rounds", type=int, default=15, help="how often; by default %(default)s times")
    made.add_argument("--quick", action="store_true", help="only so long that everything is seen to work")
    return made


if __name__ == "__main__":
    sys.exit(main())
