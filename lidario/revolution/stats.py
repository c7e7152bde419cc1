"""The counters of an `Assembler`: what became of each packet, and how many revolutions there were."""

from dataclasses import dataclass

from lidario.scans.scan import Scan


@dataclass(slots=True)
class AssemblerStats:
    """Running totals. All but `unfinished_packets` and `waiting_packets` only grow.

    Every packet that was added is counted in exactly one of the fields that end in ``_packets``, but for
    `lost_packets`. A packet at the seam is counted with the revolution that it begins in.
    """

    scans: int = 0  # revolutions delivered
    broken_scans: int = 0  # revolutions discarded
    # Packets missing, also those of revolutions that were not delivered or of which nothing came.
    lost_packets: int = 0
    # Revolutions missing between the delivered ones: those that were broken, those of which nothing came, and those
    # that passed while the device was away, by the speed before.
    missed_scans: int = 0
    scan_packets: int = 0  # packets of revolutions delivered
    # Packets of revolutions not delivered: broken ones, and the parts of one at the beginning and the end of each
    # stream.
    discarded_packets: int = 0
    doubled_packets: int = 0  # packets that came once more, right behind themselves, and were dropped
    false_packets: int = 0  # noise that passed for a packet, as its angle shows
    waiting_packets: int = 0  # packets that wait, until the next ones show whether they are false or late
    unfinished_packets: int = 0  # packets of the revolution in the making
    # Stamp and duration, in nanoseconds, of the last revolution before the device went away. Kept until the first
    # revolution after it is back. Not a counter.
    left_off: tuple[int, float] | None = None

    @property
    def all_packets(self) -> int:
        """Packets that came, and those that are counted as lost."""
        return self.scan_packets + self.discarded_packets + self.unfinished_packets + self.lost_packets

    def leave_off(self, last: Scan) -> None:
        """The device is away; `last` was the last scan before that."""
        revolution_ns = 60e9 / last.rpm if last.rpm > 0 else float(last.duration_ns)
        self.left_off = last.stamp_ns, revolution_ns

    def resume(self, start_ns: int) -> None:
        """A revolution begins at `start_ns`: if the device was away, count those missed meanwhile, at least one."""
        if self.left_off is not None:
            last_ns, revolution_ns = self.left_off
            self.left_off = None
            self.missed_scans += max(1, round((start_ns - last_ns) / max(revolution_ns, 1.0)) - 1)

    def break_scan(self) -> None:
        """Count a whole revolution that is discarded."""
        self.broken_scans += 1
        self.missed_scans += 1

    def finish(self, packets: int, *, delivered: bool) -> None:
        """Count packets of a revolution that has ended."""
        self.unfinished_packets -= packets
        if delivered:
            self.scan_packets += packets
        else:
            self.discarded_packets += packets
