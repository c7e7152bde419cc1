"""The file of a recording is removed, emptied or written by others; is what it is made of; has a name they want."""

from collections.abc import Callable
from pathlib import Path

import pytest

import lidario
from lidario.basics.model import DeviceInfo
from lidario.recording.about import About
from lidario.recording.parts import Parts, Split
from tests.support.devices import scanning
from tests.support.loop import driven, run_driven
from tests.support.recorded import record


def removed(path: Path) -> None:
    path.unlink()


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def begun_again(path: Path) -> None:
    """As another program does, which does not ask who has locked it."""
    path.write_bytes(bytes(1000))


@pytest.mark.parametrize(
    ("harm", "why"),
    [
        (removed, "was removed while it was written"),
        (emptied, "was changed by another program"),
        (begun_again, "was changed by another program"),
    ],
    ids=["removed", "emptied", "begun again"],
)
@driven
async def test_a_file_taken_away_ends_the_recording(tmp_path: Path, harm: Callable[[Path], None], why: str) -> None:
    """Nothing is written to what is another program's file by then."""
    path = tmp_path / "a.mcap"
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        async with lidar.record(path) as recording, scanning(lidar):
            harm(path)
            before = path.read_bytes() if path.exists() else None
            await recording.close()
        assert recording.error is not None
        assert why in str(recording.error)
        assert recording.lost_bytes > 0
    assert (path.read_bytes() if path.exists() else None) == before


def test_a_recording_does_not_replace_what_it_is_made_of(tmp_path: Path) -> None:
    live = record(tmp_path / "a.mcap", "sim://rplidar-s2", 2)
    (tmp_path / "link.mcap").symlink_to(live.path)
    before = live.path.read_bytes()

    async def main() -> None:
        async with lidario.open_lidar(live.path) as lidar:
            for name in (live.path, tmp_path / "link.mcap"):
                with pytest.raises(lidario.CannotRecord, match="is read meanwhile"):
                    await lidar.record(name, overwrite=True).start()

    run_driven(main)
    assert live.path.read_bytes() == before


def test_recorders_that_begin_at_one_moment_share_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each looks whether the name is free, and then both make the file. The recording of one of them ended."""
    monkeypatch.setattr("os.path.lexists", lambda _: False)
    about = About(DeviceInfo("rplidar", "A1", 0, "", 0, "00"))
    split = Split(seconds=1.0)
    recorders = [Parts(tmp_path / "run.mcap", about, split, overwrite=True, sync=False) for _ in range(2)]
    for at_s in (0, 5):
        for each in recorders:
            each.writer_at(at_s * 10**9)
    for each in recorders:
        each.writer.close()
    assert [path.name[-9:-6] for path in sorted(tmp_path.iterdir())] == ["000", "001", "005", "006"]
