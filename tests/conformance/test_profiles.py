"""Every simulated model keeps every rule; those that are made to differ break just what they are made for."""

from __future__ import annotations

import logging

import pytest

import lidario
from lidario.conformance import RULES, Outcome
from lidario.families.registry import FAMILIES
from tests.conformance.bench import broken, judge

MODELS = [model for family in FAMILIES for model in family.simulated]
MADE_WRONG = {
    # They tell twice the time of a sample, or that of another format.
    "rplidar-wrong-us": {"sample-time"},
    "rplidar-other-format": {"sample-time"},
    # Nothing that a host can write reaches their motor.
    "rplidar-a2-no-board": {"stands-at-the-end"},
    "rplidar-c1-fixed": {"stands-at-the-end"},
    # Nobody names it here, so it is taken for an X2, which tells its speed in another way.
    "ydlidar-tx8": {"reported-speed"},
}


@pytest.mark.long
@pytest.mark.exhaustive("model", sample=[*dict.fromkeys([*MADE_WRONG, *MODELS[::4]])], full=MODELS)
def test_every_model_keeps_every_rule(model: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL, logger="lidario")
    device = lidario.simulate(model)
    verdicts = judge(device)
    assert set(broken(verdicts)) == MADE_WRONG.get(model, set()), broken(verdicts)
    assert len(verdicts) == len(RULES)
    asked = any(each.name == "get_info" and each.obeyed for each in device.log)
    untried = {each.rule.name for each in verdicts if each.outcome is Outcome.NOT_TRIED}
    assert len(untried) <= (6 if asked else 22), untried
