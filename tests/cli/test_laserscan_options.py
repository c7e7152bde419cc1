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
    """Also of a beam that the settings take out."""
    path, exported, config = tmp_path / "run.mcap", tmp_path / "exported.mcap", tmp_path / "a.toml"
    save_config(config, "", filters=[AngularBoundsFilter([(0.5, 1.5)], invert=True)])
    told = (*OPTIONS, "--config", str(config), "--filtered")
    invoke_driven("record", C1, "-n", "3", "-o", str(path), "--scans", *told, "inf", code=0)
    invoke("export", str(path), str(exported), *told, "zero", code=0)
    for file, filtered in ((path, np.inf), (exported, 0.0)):
        messages = scans_of_file(file)
        assert len(messages) >= 3
        for message in messages:
            assert len(message.ranges) == 90
            assert message.header.frame_id == "front"
            assert message.angle_increment == pytest.approx(-2 * math.pi / 90)
            assert message.time_increment > 0
            # Ninety degrees, and half a turn of the preset.
            assert message.angle_max - math.pi / 90 == pytest.approx(-math.pi / 2, abs=1e-5)
            angles = message.angle_min + message.angle_increment * np.arange(90) - 1.5 * math.pi
            inside = np.abs(np.remainder(angles, math.tau) - 1.0) < 0.45
            assert (np.asarray(message.ranges)[inside] == filtered).all()
            assert inside.sum() > 10
