"""The file that a verb shall write is looked at before a lidar is opened, which may take half a minute."""

from pathlib import Path

import pytest

from tests.cli.processes import invoke

NOWHERE = "/dev/nothing-is-here"


@pytest.mark.parametrize(("verb", "name"), [("plot", "x.svg"), ("record", "x.mcap"), ("report", "x.mcap")])
def test_one_that_is_there_is_replaced_by_force_alone(verb: str, name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"mine")
    ended = invoke(verb, NOWHERE, "-o", str(path))
    assert (ended.exit_code, ended.stdout) == (4, "")
    assert ended.stderr == f"error: {path} exists already: overwrite=True, or --force, replaces it\n"
    # Then it is the lidar that is missing.
    assert invoke(verb, NOWHERE, "-o", str(path), "--force").exit_code == 3
    assert path.read_bytes() == b"mine"


@pytest.mark.parametrize(
    "words",
    [
        ("plot", NOWHERE, "-o", "x.svg"),
        ("record", NOWHERE, "-o", "x.mcap"),
        ("record", NOWHERE, "--split", "1m", "-o", "x.mcap"),
        ("report", NOWHERE, "-o", "x.mcap"),
        ("calibrate", NOWHERE, NOWHERE, "--picture", "x.svg"),
    ],
    ids=" ".join,
)
def test_one_that_cannot_be_written(words: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "no-such-folder" / words[-1]
    ended = invoke(*words[:-1], str(path))
    assert (ended.exit_code, ended.stdout) == (4, "")
    assert ended.stderr == f"error: {path} cannot be written: no such file or directory\n"
