"""Puts the tables of a run where they are read, so that no figure there was typed by hand.

What tells of the machine goes into `benchmarks/README.md`. The fault tables, which are the same on every machine as
far as lidario is concerned, go into `docs/reliability.md`, without the date and the machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.processes import ROOT
from benchmarks.report import Table

_README = ROOT / "benchmarks" / "README.md"
_RELIABILITY = ROOT / "docs" / "reliability.md"


def insert(text: str) -> None:
    """Replace the tables of `benchmarks/README.md`."""
    _replace(_README, "tables", text)


def insert_faults(tables: Sequence[Table]) -> None:
    """Replace the fault tables of `docs/reliability.md`."""
    _replace(_RELIABILITY, "faults", "\n".join(table.markdown() for table in tables))


def _replace(path: Path, mark: str, text: str) -> None:
    """Replace what stands between two marks."""
    begin, end = f"<!-- {mark}: begin -->", f"<!-- {mark}: end -->"
    before, _, rest = path.read_text().partition(begin)
    _, _, after = rest.partition(end)
    path.write_text(f"{before}{begin}\n{text.strip()}\n{end}{after}")
