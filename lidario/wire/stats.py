"""The counters of a `Link`: what became of every received byte.

Each byte is counted in exactly one of the fields that end in ``_bytes``, or still waits in the link's buffer. So
bytes that are missing in the measurements show in another counter.
"""

from dataclasses import dataclass


@dataclass(slots=True)
class LinkStats:
    """Running totals since the link was made; they only grow.

    After every call: ``bytes_received == packet_bytes + record_bytes + skipped_bytes + response_bytes + stray_bytes
    + drained_bytes + discarded_bytes + Link.buffered``.
    """

    bytes_received: int = 0  # all bytes that came in
    packets: int = 0  # intact measurement packets
    packet_bytes: int = 0  # their bytes
    records: int = 0  # known records between packets that carry no measurement
    record_bytes: int = 0  # their bytes
    skipped_bytes: int = 0  # bytes of a stream that belong to no packet and no record
    skipped_stretches: int = 0  # stretches of such bytes that ended with a packet
    # Responses to a pending request, with their descriptors, and the descriptors of streams.
    response_bytes: int = 0
    stray_bytes: int = 0  # bytes outside a stream that are no response
    drained_bytes: int = 0  # bytes thrown away after a STOP
    discarded_bytes: int = 0  # bytes that were received but thrown away unparsed, because the host was too slow
    late_reads: int = 0  # reads before which bytes may have been lost, because the host was too slow
    # Packets among `packets` that nobody has taken: they came before their reader, or after it. If they are taken
    # late, they leave this count again.
    unread_packets: int = 0
    # Responses that nobody waits for: those to an abandoned request, and those that match the pending request in
    # type and size but begin with the echo of another one. The bytes of the second kind are stray.
    late_responses: int = 0
