"""A rotor that stands for a while: the revolution in which it stood has more packets, and none is missing."""

from __future__ import annotations

from itertools import accumulate, pairwise

import pytest

from lidario.families.rplidar.node_steps import NodeSteps
from lidario.families.spans import Heads, Turning
from lidario.families.wheel import Wheel
from tests.support.wheels import heads, lost

TURN = 23040


def turning(spans: list[int]) -> Heads:
    """Packets from which the next one is so far ahead."""
    *first, following = accumulate(spans, initial=0)
    return heads([at % TURN for at in first], following % TURN)


@pytest.mark.parametrize(
    ("turn", "spans", "step"),
    [
        (Wheel(TURN), [500, 500, 500, 250, 0, 0, 250, 500, 500, 500], 350),
        # In one in which it did nothing else, nothing tells how many there are.
        (Wheel(TURN), [0, 0, 0], 500),
        (NodeSteps(TURN), [500] * 64 + [0] * 128 + [500] * 64, 250),
        (NodeSteps(TURN), [0] * 3, 500),
    ],
)
def test_a_revolution_in_which_it_stood_has_more_of_them(turn: Turning, spans: list[int], step: float) -> None:
    turn.follow(turning([500] * 140))
    arcs = turn.follow(turning(spans))
    assert (list(arcs.arc), lost(arcs), arcs.certain) == (spans, 0, True)
    assert arcs.step == pytest.approx(step)
    assert lost(turn.follow(turning([500] * 140))) == 0


@pytest.mark.parametrize("node", [9.0, 14.4, 46.0])
@pytest.mark.parametrize("nodes", [500, 2500, 8000])
def test_one_that_creeps_out_of_standstill_has_lost_no_node(node: float, nodes: int) -> None:
    """How far a node is ahead is rounded: of one that creeps it is 0 or 1."""
    ramp = [node * at / nodes for at in range(nodes)]
    speeds = [*[node] * 200, *ramp[::-1], *[0.0] * 3000, *ramp, *[1.1 * node] * 200]
    angles = [round(at) for at in accumulate(speeds, initial=0.0)]
    turn = NodeSteps(TURN)
    turn.follow(turning([round(node)] * 140))
    arcs = turn.follow(turning([after - before for before, after in pairwise(angles)]))
    assert (lost(arcs), arcs.certain) == (0, True)
