"""When bytes came that nobody read for a while, as where the program was stopped by Ctrl-Z: against the truth."""

from hypothesis import example, given
from hypothesis import strategies as st

from lidario.port.inbox import CONNECTION, TERMINAL, Inbox, Kind

SECOND = 10**9
NEAR_NS = SECOND // 10
KEPT = {TERMINAL: 4095, CONNECTION: 550_000}
"""Bytes that the system keeps; what comes while so many wait is lost. A connection's are read in three parts."""


class Line:
    """Brings bytes at one pace; the system keeps the first ones."""

    def __init__(self, kind: Kind, pace: int) -> None:
        self.kind = kind
        self.pace = pace  # bytes a second
        self.now = 1000 * SECOND
        self.came_at = self.now  # when the last byte came that was read
        self.waiting = 0
        self.inbox = Inbox(-1, lambda: self.now, self.read, kind=kind)

    def rest(self, ns: int) -> None:
        """Nothing comes meanwhile."""
        self.now += ns

    def pass_by(self, ns: int) -> None:
        """The line brings what it does in so many nanoseconds."""
        free = KEPT[self.kind] - self.waiting
        came = self.pace * ns // SECOND
        self.came_at = self.now + ns if came <= free else self.now + free * SECOND // self.pace
        self.waiting += min(came, free)
        self.now += ns

    def read(self, _: int) -> bytes:
        if not self.waiting:
            raise BlockingIOError
        size = min(self.waiting, self.kind.more or self.kind.size)
        self.waiting -= size
        return bytes(size)

    def check(self) -> None:
        """Read all, which may take several reads, and compare the time of the last byte with the truth."""
        while self.waiting:
            self.inbox.read()
        *_, (_, at_ns) = self.inbox.take()[1]
        assert abs(at_ns - self.came_at) <= NEAR_NS


@given(
    kind=st.sampled_from(list(KEPT)),
    seconds=st.floats(0.2, 20.0),  # in which the system's buffer fills
    gaps=st.lists(st.sampled_from([0.01, 0.02, 0.3, 1.0, 5.0, 60.0]), min_size=1, max_size=12),
)
@example(kind=TERMINAL, seconds=0.6, gaps=[5.0, 0.01, 60.0, 0.01, 5.0])
@example(kind=CONNECTION, seconds=0.6, gaps=[5.0, 0.01, 60.0, 0.01, 5.0])
def test_the_last_byte_of_what_was_kept_has_its_time(kind: Kind, seconds: float, gaps: list[float]) -> None:
    # A whole number of bytes in each of the gaps.
    line = Line(kind, 100 * int(KEPT[kind] / seconds / 100))
    for gap in [0.02] * 20 + gaps:
        line.pass_by(int(gap * SECOND))
        line.check()


def test_the_pace_of_another_stream_tells_nothing() -> None:
    """A stream was stopped, and another one, at a tenth of its pace, begins later."""
    line = Line(TERMINAL, 10_000)
    for pace in (10_000, 1000):
        line.pace = pace
        for _ in range(20):
            line.pass_by(SECOND // 50)
            line.check()
        if pace == 10_000:
            line.inbox.share(False)
            line.rest(10 * SECOND)
            line.inbox.share(True)
    line.pass_by(60 * SECOND)
    line.check()
