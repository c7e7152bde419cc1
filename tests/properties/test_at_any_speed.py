"""Nothing is told as missing on a line that loses nothing, whatever the rotor does."""

import pytest

from benchmarks.truth_cases import CASES, happen
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import score
from benchmarks.truth_ways import receive

OF_THE_ROTOR = [
    "wobbling by 3 %",
    "10 to 2 Hz in 1 s",
    "10 to 1 Hz in 1 s",
    "0.5 to 10 Hz in 3 s",
    "5 to 10 Hz in 0.5 s",
    "spinning up from 2 Hz",
    "spinning up in jerks of 2 to 7.6 Hz",
    "a clock 0.5 % slow",
]


@pytest.mark.long
@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.exhaustive("speed", sample=OF_THE_ROTOR[::4], full=OF_THE_ROTOR)
def test_nothing_is_missing_where_nothing_was_lost(name: str, speed: str) -> None:
    for way in ("read", "file"):
        stream, line = happen(CASES[speed], FORMATS[name])
        found = score(stream, line, receive(stream, line, way), timed=way != "file")
        assert found.delivered == found.revolutions >= 15
        assert not any((found.wrong, found.seq_off, found.told, found.missing_revolutions, found.told_revolutions))
