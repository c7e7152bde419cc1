"""How long it takes from a source to the first scan: what users are promised, on a driven clock."""

import pytest

from benchmarks.opening import CASES, Case, first_scan_s, table

LONGEST_S = {
    Case("ydlidar", named=False, streams=False): 1.5,
    Case("ydlidar", named=False, streams=True): 2.0,
    # The vendor's own driver takes 0.39 s, with a rotor that turns already.
    Case("rplidar", named=True, streams=True): 0.39,
}


@pytest.mark.parametrize("case", LONGEST_S, ids=lambda case: case.name)
def test_the_first_scan_comes_in_time(case: Case) -> None:
    assert 0.1 < first_scan_s(case) < LONGEST_S[case]


@pytest.mark.long
def test_every_case_has_its_row() -> None:
    found, took = table()
    assert [name for name, _ in found.rows] == [case.name for case in CASES] == list(took)
