"""A program that goes to another folder while it records in parts: all of them belong into the first one."""

from pathlib import Path

import pytest

import lidario
from tests.support.loop import run_driven


@pytest.mark.long
def test_a_program_that_goes_to_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a daemon does. The other parts went there, and the first of them were not counted as kept any more."""

    async def program() -> lidario.Recording:
        async with (
            lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar,
            lidar.scans() as scans,
            lidar.record("run.mcap", split_s=1.0, keep_bytes=350_000) as recording,
        ):
            for number in range(60):
                await anext(scans)
                if number == 15:
                    monkeypatch.chdir("elsewhere")
        return recording

    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    recording = run_driven(program)
    parts = sorted(tmp_path.glob("run-*.mcap"))
    assert len(parts) > 1
    assert recording.path == parts[-1]
    assert recording.files > len(parts)
    assert sum(path.stat().st_size for path in parts) <= 350_000
    assert not list((tmp_path / "elsewhere").iterdir())
