"""Fuzz one target, or all one after the other: ``python -m tests.fuzz link -max_total_time=600``.

With `atheris` (a package of its own, for Linux) the search is guided by what code the bytes reach. Without it
Hypothesis draws bytes around the seeds. A finding is printed with the command that repeats it, and ends the run.
New interesting bytes are kept in ``.fuzz/TARGET``, from where the next run goes on.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

_CORPUS = Path(".fuzz")
_ROUND = 200  # examples
_MOST_MB = 8192
"""Atheris itself grows, by about 55 kB for each run of `decoders`: 3 GB in ten minutes, where the same inputs in
plain Python stay at 66 MB. Its own limit, 2 GB, would end the run as if that were a finding. What a target may keep
is measured by the target (`tests.fuzz.recordings`) and by the tests of each buffer, not by this limit."""


def main(arguments: list[str] | None = None) -> int:
    """Fuzz what was asked for; 1 with a finding."""
    options = _parser().parse_args(arguments)
    atheris = _atheris() if options.engine != "hypothesis" else None
    if atheris is not None and options.target is not None and options.repeat is None:
        with atheris.instrument_imports(include=["lidario"]):
            from tests.fuzz.targets import TARGETS
    else:
        from tests.fuzz.targets import TARGETS
    if options.target is None:
        return max(_alone(name, options) for name in TARGETS)
    if options.target not in TARGETS:
        print(f"there is no target {options.target!r}; there are {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    target = TARGETS[options.target]
    if options.repeat is not None:
        target.run(bytes.fromhex(options.repeat))
        return 0
    folder = _CORPUS / options.target
    folder.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(target.seeds):
        (folder / f"seed-{number}").write_bytes(seed)

    def one(data: bytes) -> None:
        try:
            target.run(bytes(data))
        except BaseException:
            print(
                f"\nFINDING: python -m tests.fuzz {options.target} --repeat {bytes(data).hex() or '00'}", flush=True
            )
            raise

    if atheris is None:
        return _with_hypothesis(options.target, one, target.seeds, target.most, options.max_total_time)
    flags = [
        f"-max_total_time={options.max_total_time}",
        f"-max_len={target.most}",
        "-timeout=60",
        f"-rss_limit_mb={options.rss_limit_mb}",
    ]
    flags += ["-print_final_stats=1", f"-artifact_prefix={folder}-"]
    atheris.Setup([sys.argv[0], *flags, str(folder)], one)
    atheris.Fuzz()  # ends the process
    return 0


def _alone(name: str, options: argparse.Namespace) -> int:
    """Fuzz one target in a process of its own: an engine ends its process."""
    print(f"--- {name}, {options.max_total_time} s", flush=True)
    command = [sys.executable, "-m", "tests.fuzz", name, f"-max_total_time={options.max_total_time}"]
    command += [f"-rss_limit_mb={options.rss_limit_mb}"]
    return min(1, abs(subprocess.run([*command, "--engine", options.engine], check=False).returncode))


def _with_hypothesis(
    name: str, one: Callable[[bytes], None], seeds: Sequence[bytes], most: int, seconds: float
) -> int:
    beginnings = st.sampled_from(seeds)
    spliced = st.tuples(beginnings, st.integers(0, most), st.binary(max_size=64), st.integers(0, 64)).map(
        lambda parts: (parts[0][: parts[1]] + parts[2] + parts[0][parts[1] + parts[3] :])[:most]
    )
    end, examples = time.monotonic() + seconds, 0
    while time.monotonic() < end:

        @settings(
            max_examples=_ROUND,
            deadline=None,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(st.one_of(spliced, st.binary(max_size=most)))
        def search(data: bytes) -> None:
            if time.monotonic() < end:
                one(data)

        search()
        examples += _ROUND
    print(f"{name}: about {examples} examples in {seconds:g} s, no finding")
    return 0


def _atheris() -> Any:
    """The engine, or None where it is not installed."""
    try:
        return import_module("atheris")
    except ImportError:
        return None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("target", nargs="?", help="one of them; all without")
    parser.add_argument("-max_total_time", type=int, default=600, metavar="SECONDS", help="for each target")
    parser.add_argument(
        "-rss_limit_mb", type=int, default=_MOST_MB, metavar="MB", help="memory of the engine; 0 for any"
    )
    parser.add_argument("--engine", choices=("atheris", "hypothesis"), default="atheris", help="which is preferred")
    parser.add_argument("--repeat", metavar="HEX", help="run the target on these bytes")
    return parser


if __name__ == "__main__":
    sys.exit(main())
