"""Which revolutions are decoded as one block: those of which nothing may be missing, and that have one seam."""

import pytest

from benchmarks.floods.bytes import blob
from benchmarks.streams import KINDS, capture
from lidario.revolution.assemble import Assembler
from lidario.revolution.partial import MOST_IN_A_PART
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.seam import Split
from lidario.revolution.together import joined
from lidario.wire.blocks import packet_offsets
from lidario.wire.envelope import DESCRIPTOR_SIZE
from lidario.wire.events import Packets

EACH = 80
"""Packets of a revolution."""
FIRST = 28
"""The packet that ends the first revolution, of those that come."""
OTHER_SEAM = 23040 // 4
READ_NS = 76_250_000
"""What 61 packets take."""


def halfway() -> tuple[Assembler, Packets]:
    """In the midst of a revolution of an S2, and what comes next: its end, and three more."""
    kind = KINDS["0x85 dense"]
    raw, pipeline = capture(kind, 1.0)[DESCRIPTOR_SIZE:], Pipeline(kind.stream())
    read = 61 * pipeline.stream.format.shortest
    for number in range(4):
        pipeline.receive(raw[number * read : (number + 1) * read], (number + 1) * READ_NS)
    pipeline.link.receive_data(raw[4 * read : 9 * read], 9 * READ_NS)
    (event,) = pipeline.link.events_received()
    assert isinstance(event, Packets)
    return pipeline.assembler, event


CLEAN = Split(FIRST + EACH, marked=False, broken=False, seam=0)


@pytest.mark.parametrize(
    ("second", "scans"),
    [
        (CLEAN, 2),
        (CLEAN._replace(broken=True), 0),
        (CLEAN._replace(moved=True), 0),
        (CLEAN._replace(marked=True), 0),
        # A mark that ended no revolution has moved it.
        (CLEAN._replace(seam=OTHER_SEAM), 0),
    ],
)
def test_one_block_has_one_seam(second: Split, scans: int) -> None:
    assembler, event = halfway()
    before = assembler.stats.scan_packets
    first = Split(FIRST, marked=False, broken=False, seam=0)
    made = assembler.add_block(event, packet_offsets(event.blocks), [first, second], 0, {})
    assert len(made) == scans
    # It has changed nothing where it has made none.
    assert (assembler.stats.scan_packets == before) == (not made)


def test_each_part_is_a_step_also_where_no_revolution_ends() -> None:
    """As of a peer that floods: all packets have one angle."""
    pipeline = Pipeline(KINDS["0x85 dense"].stream())
    pipeline.link.receive_data(blob("endless", 84 * 3 * MOST_IN_A_PART), 1)
    packets = joined([event for event in pipeline.link.events_received() if isinstance(event, Packets)])
    assert list(pipeline.take(packets)) == [[], [], []]
