"""What `lidario export` makes of a recording that was cut: a file that every reader of MCAP finds whole."""

from pathlib import Path

from mcap.reader import SeekingReader

import lidario
from lidario.recording.files import open_stored
from tests.cli.processes import invoke
from tests.support.recorded import assert_same_scans


def assert_export_makes_it_whole(cut: Path, whole: Path) -> None:
    assert lidario.summarize(cut).damage
    invoke("export", str(cut), str(whole), code=0)
    assert lidario.summarize(whole).damage == ""
    scans, again = list(lidario.decode_file(cut)), list(lidario.decode_file(whole))
    assert_same_scans(scans, again)
    assert len(again) == len(scans) > 2
    stored = [b"".join(piece.data for piece in open_stored(path).pieces()) for path in (cut, whole)]
    assert stored[0] == stored[1]
    with whole.open("rb") as file:
        # It reads by the index at the end alone.
        reader = SeekingReader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.chunk_indexes
        counted = {channel.topic: 0 for channel in summary.channels.values()}
        for _, channel, _ in reader.iter_messages():
            counted[channel.topic] += 1
        assert sum(counted.values()) == summary.statistics.message_count
        assert counted["/scan"] == len(scans)
