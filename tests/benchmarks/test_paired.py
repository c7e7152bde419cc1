"""Two checkouts are compared in one run, and what cannot be compared is refused in one sentence.

No figure is looked at: a shared machine has none to rely on.
"""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks import paired, report
from benchmarks.processes import ROOT
from benchmarks.report import Table

DENSE = "0x85 dense"


def git(folder: Path, *arguments: str) -> str:
    who = ("-c", "user.name=x", "-c", "user.email=x@y")
    done = subprocess.run(["git", "-C", str(folder), *who, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """One with two commits of one file."""
    git(tmp_path, "init", "-q")
    for text in ("one", "two"):
        (tmp_path / "file").write_text(text)
        git(tmp_path, "add", "file")
        git(tmp_path, "commit", "-q", "-m", text)
    return tmp_path


def test_another_commit_stands_beside_this_one_for_a_while(repository: Path) -> None:
    with paired.checked_out("HEAD~1", repository) as other:
        assert (other.root / "file").read_text() == "one"
        assert other.name == git(repository, "rev-parse", "--short", "HEAD~1")
    assert not other.root.exists()
    assert len(git(repository, "worktree", "list").splitlines()) == 1
    assert (repository / "file").read_text() == "two"


def test_an_unknown_commit_is_refused(repository: Path) -> None:
    with (
        pytest.raises(paired.Refused, match="there is no commit 'nosuch'"),
        paired.checked_out("nosuch", repository),
    ):
        pass


def test_a_folder_that_is_no_repository_is_refused(tmp_path: Path) -> None:
    with pytest.raises(paired.Refused, match="is no git repository"), paired.checked_out("HEAD", tmp_path):
        pass


def test_without_git_it_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert paired.main(["--against", "HEAD"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "nothing compared: git is not installed, and only git has the code of another commit\n"


def test_it_prints_both_revisions(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    @contextmanager
    def other(commit: str) -> Iterator[paired.Checkout]:
        yield paired.Checkout(commit, ROOT)

    monkeypatch.setattr(paired, "checked_out", other)
    monkeypatch.setattr(paired, "compare_decode", lambda *_: Table("decoding", ["format"]))
    assert paired.main(["--against", "1234567", "--only", "decode"]) == 0
    assert f"- revisions: 1234567 and {report.machine()['revision']} (this code)\n" in capsys.readouterr().out


@pytest.mark.long
def test_both_checkouts_decode_by_turns() -> None:
    here = paired.Checkout("here", ROOT)
    table = paired.compare_decode(here, paired.Checkout("there", ROOT), 1, [DENSE], [4096, 65536])
    ((name, *ratios),) = table.rows
    assert (name, len(ratios)) == (DENSE, 2)
    assert all(float(part) > 0 for cell in ratios for part in cell.split(", "))
    assert "of there to that of here" in table.title


@pytest.mark.long
def test_a_checkout_that_cannot_decode_is_named(tmp_path: Path) -> None:
    other = paired.Checkout("other", tmp_path)
    with pytest.raises(paired.Refused, match=f"^other cannot decode {DENSE}: it has no benchmarks"):
        paired.compare_decode(other, paired.Checkout("here", ROOT), 1, [DENSE], [65536])


def test_live_figures_of_both_stand_beside_each_other() -> None:
    old = [{"cpu": 0.02, "wakeups": 30.0, "late": [1.0, 3.0], "lost": 0}] * 2
    new = [{"cpu": 0.01, "wakeups": 20.0, "late": [2.0, 2.0], "lost": 1}] * 2
    assert paired.live_row("S2", old, new) == [
        "S2", "0.50", "2.00, 1.00", "30, 20", "2.00, 2.00", "3.00, 2.00", "0, 2",
    ]  # fmt: skip
