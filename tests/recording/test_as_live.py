"""A file is decoded and replayed to the scans of the session that recorded it, whatever happened on the line."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

import lidario
from lidario.recording.decode_file import FileDecoder
from lidario.recording.read import McapRecording, Piece
from tests.support.recorded import assert_same_scans, record, replayed

STALLED = "stall:300ms"
"""Once a second the bytes of three revolutions come at once."""
MODELS = ["rplidar-s2", "rplidar-a1", "ydlidar-4ros", "ldrobot-ld06"]
BY_FAULT = {
    "": (12, MODELS[::2]),
    "flip:0.02%": (12, MODELS[::2]),
    "drop:1%": (12, MODELS[:1]),
    "drop:0.1%": (50, MODELS),
    "stall:400ms": (50, MODELS),
    f"drop:0.1%,{STALLED}": (50, MODELS),
    f"burst:0.01%,{STALLED}": (50, MODELS),
    "replug:6s": (80, MODELS),
    "reboot:6s": (80, MODELS[::2]),
}
"""How many scans of which models."""
CASES = [(model, fault, count) for fault, (count, models) in BY_FAULT.items() for model in models]


@pytest.mark.long
@pytest.mark.parametrize(("model", "fault", "count"), CASES)
def test_scans_are_those_of_the_live_session(tmp_path: Path, model: str, fault: str, count: int) -> None:
    live = record(tmp_path / "a.mcap", f"sim://{model}?fault={fault.replace('%', '%25')}", count)
    assert bool(live.stats.restarts + live.stats.reconnects) == fault.endswith(":6s")
    if "%" in fault or not fault:
        assert any(scan.lost_packets for scan in live.scans) == bool(fault)
    decoder = FileDecoder(live.path)
    assert_same_scans(live.scans, list(decoder))
    assert decoder.recording.damage == ""
    scans = replayed(live.path)
    assert_same_scans(live.scans, scans)
    assert len(scans) <= len(live.scans) + (3 if STALLED in fault else 1)
    assert all(scan.dropped_before == 0 for scan in scans)


@pytest.mark.long
def test_what_was_away_is_told(tmp_path: Path) -> None:
    live = record(tmp_path / "a.mcap", "sim://rplidar-s2?fault=replug:6s", 80)
    recording = McapRecording(tmp_path / "a.mcap")
    assert len(recording.away_ns) == live.stats.reconnects
    gaps = [b.stamp_ns - a.stamp_ns - a.duration_ns for a, b in pairwise(live.scans)]
    # All that lies between two scans, but for the parts of revolutions and the spinning up at the edges of a gap.
    longest = sorted(gaps)[-live.stats.reconnects :]
    assert all(0 <= gap - away < 2.5e9 for gap, away in zip(longest, sorted(recording.away_ns), strict=True))
    summary = lidario.summarize(tmp_path / "a.mcap")
    assert summary.losses == live.stats.reconnects
    assert summary.away_s == pytest.approx(sum(recording.away_ns) * 1e-9)


@pytest.mark.long
@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros"])
def test_what_is_late_behind_a_silence_when_a_recording_ends_is_decoded_and_played(
    tmp_path: Path, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    live, pieces = record(tmp_path / "a.mcap", f"sim://{model}", 16), McapRecording.pieces
    turn_ns, begun_ns = round(60e9 / live.scans[-1].rpm), live.scans[-3].stamp_ns

    def late(self: McapRecording) -> Iterator[Piece]:
        rest = b""
        for piece in pieces(self):
            rest += piece.data if begun_ns < piece.at_ns < begun_ns + 2.5 * turn_ns else b""
            if piece.at_ns <= begun_ns:
                yield (last := piece)
        yield last._replace(data=rest, at_ns=begun_ns + round(3.7 * turn_ns))

    monkeypatch.setattr(McapRecording, "pieces", late)
    decoded = list(FileDecoder(live.path))
    assert decoded[-1].stamp_ns > begun_ns + turn_ns
    assert_same_scans(replayed(live.path), decoded)
