"""The script for zsh, in an interactive zsh."""

from pathlib import Path

import pytest

from tests.support.shells import TYPED, is_completed


@pytest.mark.long
@pytest.mark.exhaustive("word", sample=TYPED[-1:], full=TYPED)
def test_a_word_is_completed(tmp_path: Path, word: tuple[str, str]) -> None:
    is_completed("zsh", tmp_path, *word)
