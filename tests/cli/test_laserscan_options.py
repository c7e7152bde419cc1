"""The options of LaserScan messages: the same in each verb that makes some."""

import math
from pathlib import Path

import numpy as np
import pytest

from lidario import save_config
from lidario.filters import AngularBoundsFilter
from tests.cli.processes import invoke, invoke_driven
from tests.support.messages import scans_of_file

C1 = "sim://rplidar-c1?via=memory"
OPTIONS = ("--beams", "90", "--frame", "front", "--order", "measured", "--preset", "vendor", "--mount-yaw", "90")


@pytest.mark.long
def test_record_and_export_make_the_messages_that_are_asked_for(tmp_path: Path) -> None:
    path, exported = str(tmp_path / "run.mcap"), str(tmp_path / "exported.mcap")
    invoke_driven("record", C1, "-n", "3", "-o", path, "--scans", *OPTIONS, code=0)
    invoke("export", path, exported, *OPTIONS, code=0)
    for file in (path, exported):
        messages = scans_of_file(Path(file))
        assert len(messages) >= 3
        for message in messages:
            assert len(message.ranges) == 90
            assert message.header.frame_id == "front"
            assert message.angle_increment == pytest.approx(-2 * math.pi / 90)
            assert message.time_increment > 0
            # Ninety degrees, and half a turn of the preset.
            assert message.angle_max - math.pi / 90 == pytest.approx(-math.pi / 2, abs=1e-5)


@pytest.mark.long
def test_a_filtered_beam_is_what_was_asked_for(tmp_path: Path) -> None:
    path, exported, config = tmp_path / "run.mcap", tmp_path / "exported.mcap", tmp_path / "a.toml"
    save_config(config, "", filters=[AngularBoundsFilter([(0.5, 1.5)], invert=True)])
    told = ("--config", str(config), "--filtered", "inf")
    invoke_driven("record", C1, "-n", "3", "-o", str(path), "--scans", *told, code=0)
    invoke("export", str(path), str(exported), *told[:3], "zero", code=0)
    for file, value in ((path, np.inf), (exported, 0.0)):
        for message in scans_of_file(file):
            turned = message.angle_min + message.angle_increment * np.arange(len(message.ranges))
            inside = np.abs(np.remainder(turned, math.tau) - 1.0) < 0.48
            assert (np.asarray(message.ranges)[inside] == value).all()
