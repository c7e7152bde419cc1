"""The load of a line: a share, or none where the line has no speed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lidario import Stats
from lidario.web.traffic import traffic


@pytest.mark.parametrize(
    ("bytes_received", "baudrate", "load"),
    [
        (11_520, 115_200, 1.0),
        (5_760, 115_200, 0.5),
        (12_000, 115_200, 1.04),
        (21_000, 115_200, None),
        (21_000, 0, None),
    ],
)
def test_a_line_that_carries_too_much_has_no_speed(bytes_received: int, baudrate: int, load: float | None) -> None:
    before = Stats()
    found = traffic(before, replace(before, bytes_received=2 * bytes_received), 2.0, baudrate).load
    assert found == (load if load is None else pytest.approx(load, abs=0.01))
