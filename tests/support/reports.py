"""The collection of reports that owners have sent: `tests/data/reports/README.md` tells its form.

::

    python -m tests.support.reports report.mcap --who "name or handle"   # add one
    python -m tests.support.reports                                      # write anew what is made of them all
"""

import argparse
import json
import lzma
import re
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

import lidario
from lidario.conformance import Outcome, Report, Seen, read_report

ROOT = Path(__file__).parents[2]
REPORTS = ROOT / "tests/data/reports"
DEVICES = ROOT / "docs/devices.md"
SEEN = ROOT / "lidario/conformance/seen.json"
BEGIN, END = "<!-- reports: begin -->\n", "<!-- reports: end -->\n"
NONE = "No report has come yet: nothing on this page was seen with a real device by the authors.\n"


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The recording in a file of the collection."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / path.stem
        file.write_bytes(lzma.decompress(path.read_bytes()))
        yield file


def text_of(path: Path, who: str) -> str:
    """What is expected of a report: the device, a line for each mode, each scan and each rule."""
    report, info = read_report(path), read_report(path).about.info
    lines = [
        f"who {who}",
        f"device {info.model}, firmware {info.firmware or 'not told'}, hardware {info.hardware}",
        *(f"fact {name}: {text}" for name, text in report.facts.items()),
    ]
    for mode in report.modes:
        kind = f"0x{mode.response_type:02X}"
        lines.append(f"mode {mode.name}: {kind}, {mode.sample_us:.3f} us, {mode.max_distance:g} m")
    for scan in lidario.decode_file(path):
        lines.append(
            f"scan {scan.seq} of {scan.mode}: {len(scan)} samples, {int(scan.valid.sum())} returns, "
            f"{scan.lost_packets} packets lost, {_sum(scan):08x}"
        )
    lines += [f"rule {each.rule}: {each.outcome.value}: {each.text}" for each in report.tried]
    return "\n".join(lines) + "\n"


def _sum(scan: lidario.Scan) -> int:
    """A check value of what is in a scan; of angles to a hundredth of a degree: their last bits may differ."""
    angles = np.round(np.degrees(scan.angles) * 100).astype("<i4")
    ranges = np.round(np.nan_to_num(scan.ranges) * 4000).astype("<i4")
    return zlib.crc32(ranges.tobytes(), zlib.crc32(angles.tobytes()))


def seen_of(path: Path) -> Seen:
    """What a report in the collection adds to what is known."""
    with unpacked(path) as file:
        report = read_report(file)
    who = path.with_suffix("").with_suffix(".txt").read_text(encoding="utf-8").splitlines()[0].removeprefix("who ")
    when = datetime.fromtimestamp(report.about.began_ns * 1e-9, UTC).strftime("%Y-%m-%d")
    info, facts = report.about.info, report.facts
    return Seen(
        info.model, info.firmware, report.modes, who, when, facts.get("system", ""), facts.get("adapter", "none")
    )


def real_ones(folder: Path) -> list[Path]:
    """The reports in a folder that are of real devices."""
    found = list[Path]()
    for path in sorted(folder.glob("*.mcap.xz")):
        with unpacked(path) as file:
            if not read_report(file).is_simulated:
                found.append(path)
    return found


def table_of(seen: Iterable[Seen]) -> str:
    """The table in the page of devices."""
    rows = [
        f"| {each.model} | {each.firmware or '–'} | {each.system} | {each.adapter} | {each.who} | {each.when} |\n"
        for each in seen
    ]
    head = "| model | firmware | system | adapter | who | when |\n|---|---|---|---|---|---|\n"
    return head + "".join(rows) if rows else NONE


def json_of(seen: Iterable[Seen]) -> str:
    """The file that `news_of` compares with."""
    entries = [{**each._asdict(), "modes": [asdict(mode) for mode in each.modes]} for each in seen]
    return json.dumps(entries, indent=1) + "\n"


def write_all(folder: Path = REPORTS, devices: Path = DEVICES, seen_file: Path = SEEN) -> None:
    """Write anew what is made of the collection: the table of devices, and what is known."""
    seen = [seen_of(path) for path in real_ones(folder)]
    page = devices.read_text(encoding="utf-8")
    begin, end = page.index(BEGIN) + len(BEGIN), page.index(END)
    devices.write_text(page[:begin] + table_of(seen) + page[end:], encoding="utf-8")
    seen_file.write_text(json_of(seen), encoding="utf-8")


def add(path: Path, who: str, folder: Path = REPORTS) -> Path:
    """Put a report into the collection; returns its file there.

    Raises:
        ValueError: It is not complete, or there already.
    """
    report = read_report(path)
    if not report.is_complete:
        raise ValueError(f"{path}: it was ended before all rules had their turn")
    target = folder / f"{_name_of(report)}.mcap.xz"
    if target.exists():
        raise ValueError(f"{target.name} is there already")
    text = text_of(path, who)
    target.write_bytes(lzma.compress(path.read_bytes(), preset=9))
    target.with_suffix("").with_suffix(".txt").write_text(text, encoding="utf-8")
    return target


def _name_of(report: Report) -> str:
    """Model, firmware, and what tells two devices of one kind apart."""
    info = report.about.info
    when = datetime.fromtimestamp(report.about.began_ns * 1e-9, UTC).strftime("%Y%m%d")
    parts = ("simulated" if report.is_simulated else "", info.model, info.firmware, info.serial[:6], when)
    return "-".join(re.sub(r"[^a-z0-9.]+", "-", part.lower()).strip("-") for part in parts if part)


def main() -> None:
    """Add what is named, then write anew what is made of all."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.reports", description=__doc__)
    parser.add_argument("report", type=Path, nargs="?", help="a file of `lidario report`")
    parser.add_argument("--who", default="", help="who has sent it, as it is to be shown")
    options = parser.parse_args()
    if options.report is not None:
        if not options.who:
            parser.error("--who says who has sent it")
        target = add(options.report, options.who)
        broken = read_report(options.report).with_outcome(Outcome.BROKEN)
        print(f"{target.relative_to(ROOT)}: {len(broken)} rules not held; look at its .txt before you commit it")
    write_all()


if __name__ == "__main__":
    main()
