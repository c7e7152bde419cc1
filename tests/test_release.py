"""`make release`: one command makes the version, the commit and the tag, or says what is wrong."""

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {
    "PATH": os.environ["PATH"],
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_CONFIG_NOSYSTEM": "1",
    **{f"GIT_{who}_{what}": "a@b.c" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")},
}
CHANGELOG = "# Changelog\n\n## Unreleased: 1.2.0\n\n- A new thing.\n\n## 1.1.0, 2026-01-01\n\n- An old thing.\n"


class Clone:
    """A repository with what a release reads and writes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in (".ci/release", "lidario/version.py"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
        (folder / "docs").mkdir()
        (folder / "docs" / "index.md").write_text("$ pip install 'lidario-asyncio[cli]'\n")
        (folder / "README.md").write_text("Linux, Python 3.11 or later.\n")
        (folder / "CHANGELOG.md").write_text(CHANGELOG)
        self.git("init", "--quiet", "--initial-branch=main")
        self.commit()

    def git(self, *words: str) -> str:
        return self._run("git", *words).stdout

    def commit(self) -> None:
        self.git("add", "--all")
        self.git("commit", "--quiet", "--message", "before")

    def release(self, version: str) -> subprocess.CompletedProcess[str]:
        return self._run("bash", ".ci/release", version, check=False)

    def text(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")

    def _run(self, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            words, cwd=self.folder, env=ENVIRONMENT, check=check, capture_output=True, text=True, timeout=60
        )


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    folder = tmp_path / "with a space"
    folder.mkdir()
    return Clone(folder)


def test_one_command_makes_the_version_the_section_the_commit_and_the_tag(clone: Clone) -> None:
    ended = clone.release("1.2.0")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "git push --atomic origin HEAD v1.2.0" in ended.stdout
    assert clone.git("status", "--porcelain") == ""
    assert clone.git("log", "--format=%s").split("\n")[:2] == ["Release 1.2.0", "before"]
    assert clone.git("rev-list", "-1", "v1.2.0") == clone.git("rev-parse", "HEAD")
    assert clone.git("cat-file", "-t", "v1.2.0") == "tag\n"
    assert clone.git("diff", "--name-only", "HEAD~").split() == ["CHANGELOG.md", "lidario/version.py"]
    today = clone.git("log", "-1", "--format=%ad", "--date=short").strip()
    assert clone.text("CHANGELOG.md") == CHANGELOG.replace("## Unreleased: 1.2.0", f"## 1.2.0, {today}")
    before = (ROOT / "lidario" / "version.py").read_text(encoding="utf-8")
    assert clone.text("lidario/version.py") == re.sub(r'(__version__ = )".*"', r'\1"1.2.0"', before)


def test_the_version_that_stands_there_already_is_released_too(clone: Clone) -> None:
    (clone.folder / "lidario" / "version.py").write_text('__version__ = "1.2.0"\n')
    clone.commit()
    assert clone.release("1.2.0").returncode == 0
    assert clone.text("lidario/version.py") == '__version__ = "1.2.0"\n'


def _without_section(clone: Clone) -> None:
    (clone.folder / "CHANGELOG.md").write_text("# Changelog\n\n## 1.2.0, 2026-01-01\n\n- Old.\n")
    clone.commit()


def _with_nothing_in_the_section(clone: Clone) -> None:
    (clone.folder / "CHANGELOG.md").write_text(CHANGELOG.replace("- A new thing.\n", ""))
    clone.commit()


def _says_that_it_is_not_released(clone: Clone) -> None:
    (clone.folder / "README.md").write_text("It is not released yet.\n")
    clone.commit()


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda clone: (clone.folder / "left.txt").write_text("x"), "the working tree has changes"),
        (lambda clone: clone.git("tag", "v1.2.0"), "the tag v1.2.0 exists"),
        (_without_section, "CHANGELOG.md has no line: ## Unreleased: 1.2.0"),
        (_with_nothing_in_the_section, "CHANGELOG.md says nothing below: ## Unreleased: 1.2.0"),
        (_says_that_it_is_not_released, "README.md"),
    ],
)
def test_what_is_not_ready_is_refused_unchanged(clone: Clone, spoil: Callable[[Clone], object], says: str) -> None:
    spoil(clone)
    before = [clone.git("rev-parse", "HEAD"), clone.git("tag"), clone.git("status", "--porcelain")]
    ended = clone.release("1.2.0")
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: ")
    assert says in ended.stderr
    assert [clone.git("rev-parse", "HEAD"), clone.git("tag"), clone.git("status", "--porcelain")] == before


@pytest.mark.parametrize("version", ["", "1.2", "v1.2.0", "1.02.0", "1.2.0rc1", "1.2.0; echo x", "x.y.z"])
def test_what_is_no_version_is_refused(clone: Clone, version: str) -> None:
    ended = clone.release(version)
    assert ended.returncode == 2
    assert "make release VERSION=1.2.3" in ended.stderr


def test_our_own_changelog_has_the_line_that_a_release_looks_for() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (Unreleased: )?\d+\.\d+\.\d+(, \d{4}-\d\d-\d\d)?$", text, re.MULTILINE)
