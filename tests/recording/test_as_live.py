"""A file is decoded to the scans of the session that recorded it, however its reads are joined."""

from pathlib import Path

import pytest

from lidario.recording.decode_file import FileDecoder
from tests.support.recorded import assert_same_scans, record

STALLED = "stall:300ms"
"""Once a second the bytes of three revolutions come at once."""


@pytest.mark.long
@pytest.mark.parametrize("fault", [f"drop:0.1%,{STALLED}", f"burst:0.01%,{STALLED}", "stall:400ms", "drop:0.1%"])
@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a1", "ydlidar-4ros", "ldrobot-ld06"])
def test_a_file_is_decoded_to_the_scans_of_the_session(tmp_path: Path, model: str, fault: str) -> None:
    live = record(tmp_path / "a.mcap", f"sim://{model}?fault={fault.replace('%', '%25')}", 50)
    scans = list(FileDecoder(live.path))
    assert len(live.scans) == 50
    assert_same_scans(live.scans, scans)
