"""The script for bash, in an interactive bash."""

from pathlib import Path

import pytest

from tests.support.shells import TYPED, is_completed


@pytest.mark.long
@pytest.mark.exhaustive("word", sample=[TYPED[0], TYPED[-1]], full=TYPED)
def test_a_word_is_completed(tmp_path: Path, word: tuple[str, str]) -> None:
    is_completed("bash", tmp_path, *word)
