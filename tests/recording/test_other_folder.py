"""A program that goes to another folder, as a daemon does: what it records or plays goes on in the first one."""

from pathlib import Path

import pytest

import lidario
from tests.reference.golden import load
from tests.support.loop import run_driven
from tests.support.recorded import record


@pytest.mark.long
def test_while_it_records_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other parts went there, and the first of them were not counted as kept any more."""

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


@pytest.mark.parametrize("name", ["run.mcap", "run-*.mcap", "run.bin"])
def test_while_it_plays_or_decodes(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was said that a file does not exist: at the second turn of a loop, or with the second part.

    And it could be replaced while it was read.
    """
    if name == "run.bin":
        (tmp_path / name).write_bytes(load("ldrobot_ld19_13hz").raw)
    else:
        record(tmp_path / "run.mcap", "sim://rplidar-s2", 20, split_s=1.0 if "*" in name else None)

    played = next(tmp_path.glob(name))

    async def program() -> None:
        async with lidario.open_lidar(f"{name}?loop=1&rate=0") as lidar, lidar.scans() as scans:
            monkeypatch.chdir("elsewhere")
            with pytest.raises(lidario.CannotRecord, match="is read meanwhile"):
                await lidar.record(played, overwrite=True).start()
            for _ in range(30):
                await anext(scans)

    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    decoded = lidario.decode_file(name)
    run_driven(program)
    assert sum(1 for _ in decoded) > 2
