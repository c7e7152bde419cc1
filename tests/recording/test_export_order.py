"""What an exported MCAP has, it has in the order of time, as the package ``mcap`` reads the file itself."""

from itertools import pairwise
from pathlib import Path

import pytest
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap
from lidario.recording.write import SCAN_TOPIC
from lidario.scans.laserscans import LaserScans
from tests.support.recorded import record


@pytest.mark.long
@pytest.mark.parametrize("fault", ["", "?fault=stall:300ms"])
@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros", "ldrobot-ld06"])
def test_chunks_and_scans_stand_in_the_order_of_time(tmp_path: Path, model: str, fault: str) -> None:
    live = record(tmp_path / "a.mcap", f"sim://{model}{fault}", 40)
    export_mcap(FileDecoder(live.path), tmp_path / "b.mcap")
    topics, messages = dict[int, str](), list[Message]()
    with open(tmp_path / "b.mcap", "rb") as file:
        # As they stand in the file: no index is used.
        for each in StreamReader(file, validate_crcs=True).records:
            if isinstance(each, Channel):
                topics[each.id] = each.topic
            elif isinstance(each, Message):
                messages.append(each)
    assert all(a.log_time <= b.log_time for a, b in pairwise(messages))
    # What came before the first chunk, too, has the time of the recording.
    assert messages[-1].log_time - messages[0].log_time < 60e9
    scans = [each.log_time for each in messages if topics[each.channel_id] == SCAN_TOPIC]
    made = LaserScans()
    ready = [message.stamp_ns for scan in FileDecoder(live.path) for _, message in made.take(scan)]
    assert scans == ready + [message.stamp_ns for _, message in made.rest()]
