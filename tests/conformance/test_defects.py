"""A simulated device with one defect breaks the rule that says so, and no rule that has nothing to do with it."""

from __future__ import annotations

import logging

import pytest

from lidario.conformance import RULES
from tests.conformance.bench import broken, judge
from tests.conformance.defects import DEFECTS, make

pytestmark = pytest.mark.discards("what is wrong with these devices may be that they discard requests")


@pytest.mark.long
@pytest.mark.parametrize("defect", DEFECTS)
def test_a_defect_is_found(defect: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL, logger="lidario")
    _, rule, others = DEFECTS[defect]
    found = broken(judge(make(defect)))
    assert set(found) == {rule} | others, found
    assert found[rule]


def test_each_rule_is_broken_by_some_defect() -> None:
    broken_by_some = {rule for _, rule, _ in DEFECTS.values()}
    broken_aside = {rule for *_, others in DEFECTS.values() for rule in others}
    assert len(broken_by_some) >= 20
    assert {rule.name for rule in RULES} <= broken_by_some | broken_aside
