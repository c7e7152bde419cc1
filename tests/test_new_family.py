"""``python -m tests.new_family``: what it writes works, and is as clean as the rest, from the first minute."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from lidario.families.base import Family
from lidario.families.registry import FAMILIES
from tests.new_family import sizes
from tests.new_family.__main__ import begin_family, main
from tests.new_family.sizes import size_of

ROOT = Path(__file__).resolve().parent.parent
BOUND = 300.0


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A copy of what a family is written into, and of what judges it."""
    left_out = shutil.ignore_patterns("__pycache__", ".peers", "results", "*.pyc")
    for name in ("lidario", "tests", "benchmarks", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=left_out)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def run(clone: Path, *command: str) -> str:
    environment = dict(os.environ, PYTHONPATH=str(clone))
    done = subprocess.run(
        [sys.executable, *command], cwd=clone, env=environment, capture_output=True, text=True, timeout=BOUND
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.mark.long
def test_a_family_is_green_from_the_first_minute(clone: Path) -> None:
    told = run(clone, "-m", "tests.new_family", "zebra")
    assert "lidario/families/zebra/formats.py" in told
    run(clone, "-m", "ruff", "check", "lidario", "tests")
    run(clone, "-m", "ruff", "format", "--check", "lidario", "tests")
    judged = [
        f"tests/{each}"
        for each in ("families/zebra", "families/test_registry.py", "test_golden.py", "test_layers.py")
    ]
    # Of the golden streams its own is new.
    only = ("-k", "zebra or test_registry or test_layers")
    assert " passed" in run(clone, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *only, *judged)
    scans = run(clone, "-m", "lidario", "scan", "sim://zebra-one?via=memory", "-n", "2")
    assert scans.splitlines()[1].split()[1] == "400"
    assert "zebra-one" in run(clone, "-m", "lidario", "sim", "--list")
    stream = clone / "tests" / "data" / "zebra_first.npz"
    made = stream.read_bytes()
    stream.unlink()
    run(clone, "-m", "tests.new_family", "zebra", "--stream")
    assert stream.read_bytes() == made


def test_no_stream_without_its_family(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["new_family", "zebra", "--stream"])
    with pytest.raises(SystemExit) as left:
        main()
    told = capfd.readouterr().err
    assert left.value.code == 2
    assert "there is no family 'zebra' yet" in told
    assert "Traceback" not in told


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_a_family_is_small(family: Family) -> None:
    """Those that came after the third: what is the same in two of them belongs beside them."""
    most = {"rplidar": None, "ydlidar": None, "ldrobot": None, "hokuyo": 500}.get(family.name, 250)
    if most is not None:
        assert sizes.sides_of(sizes.FAMILIES / family.name)[0].code <= most


def test_lines_of_code_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "some.py"
    path.write_text(
        '"""What\nit is."""\n\nx = """a\nb"""  # two\n\n\ndef f():\n    """None."""\n    # why\n    return 1\n'
    )
    assert size_of([path]) == (4, 11)


@pytest.mark.parametrize("name", ["", "Acme", "a", "my-lidar", "class", "rplidar", "base", "../x", "ünder"])
def test_a_name_that_cannot_be_one_writes_nothing(tmp_path: Path, name: str) -> None:
    families = tmp_path / "lidario" / "families"
    families.mkdir(parents=True)
    (families / "rplidar").mkdir()
    (families / "base.py").touch()
    with pytest.raises(ValueError, match=r"no name|already"):
        begin_family(tmp_path, name)
    assert sorted(path.name for path in families.iterdir()) == ["base.py", "rplidar"]
    assert not (tmp_path / "tests").exists()
