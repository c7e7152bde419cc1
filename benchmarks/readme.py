"""Puts the tables of a run into `benchmarks/README.md`, so that no figure there was typed by hand."""

from __future__ import annotations

from benchmarks.processes import ROOT

__all__ = ["insert"]

_README = ROOT / "benchmarks" / "README.md"
_BEGIN, _END = "<!-- tables: begin -->", "<!-- tables: end -->"


def insert(text: str) -> None:
    """Replace what stands between the two marks."""
    before, _, rest = _README.read_text().partition(_BEGIN)
    _, _, after = rest.partition(_END)
    _README.write_text(f"{before}{_BEGIN}\n{text.strip()}\n{_END}{after}")
