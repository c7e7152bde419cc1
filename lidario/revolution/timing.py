"""Finds when the first sample of a revolution was measured.

A packet arrives later than its last sample was measured. The delay is the time of its bytes on the wire, plus one
and a half samples in the device (vendor's SDK 2.1.0 for one family, adopted for all), plus whatever the adapter,
the kernel and the event loop add. The device measures evenly. So every packet of a revolution gives an estimate of
when the revolution began, too late by the delay of that packet, and the earliest estimate is the best one.
"""

from lidario.families.base import Samples
from lidario.revolution.ended import EndedRevolution
from lidario.wire.events import Packets

BITS_A_BYTE = 10
"""On a serial line with one start and one stop bit."""
DEVICE_DELAY_SAMPLES = 1.5


def first_sample_ns(ended: EndedRevolution, byte_ns: float) -> int:
    """When the first sample of a revolution was measured, by the least delayed packet.

    Args:
        ended: The revolution. Of its times, only `sample_ns` must be set.
        byte_ns: Nanoseconds that a byte takes on the line.
    """
    revolution, packets, samples, sample_ns = ended.partial, ended.packets, ended.samples, ended.sample_ns
    before, skipped, found = 0, 0, list[float]()
    if revolution.carried is not None:
        before, skipped = len(revolution.carried), revolution.skipped_behind_carried
        found.append(revolution.carried_ns - (before - 1) * sample_ns)
    if samples.certain:
        found += begins_of(packets, samples, before + skipped, sample_ns)
    else:
        for count, at_ns in packets.arrivals:
            if count > samples.unbroken and found:
                # Behind a gap the number of samples since the beginning is not known.
                break
            found.append(at_ns - (before + samples.ends[count - 1] - 1) * sample_ns)
    return earliest_ns(min(found), sample_ns, len(packets.data) / packets.count * byte_ns)


def begins_of(packets: Packets, samples: Samples, before: int, sample_ns: float) -> list[float]:
    """Estimate when the first sample of a revolution arrived, once by each read, as if that read was not delayed.

    Args:
        packets: The packets.
        samples: The decoded packets; its gaps must be certain.
        before: How many samples of the revolution were measured before them.
        sample_ns: Nanoseconds a sample.
    """
    ends, gaps, passed, found = samples.ends, samples.gaps, 0, list[float]()
    for count, at_ns in packets.arrivals:
        end = ends[count - 1]
        while passed < len(gaps) and gaps[passed][0] < end:
            before += gaps[passed][1]
            passed += 1
        found.append(at_ns - (before + end - 1) * sample_ns)
    return found


def earliest_ns(estimate: float, sample_ns: float, wire_ns: float) -> int:
    """When a sample was measured: the earliest estimate, less the delay by device and line of every packet."""
    return round(estimate - DEVICE_DELAY_SAMPLES * sample_ns - wire_ns)


def byte_ns_at(baudrate: int) -> float:
    """Nanoseconds that a byte takes at so many bits a second; 0 for 0, where bytes take no time."""
    return BITS_A_BYTE * 1e9 / baudrate if baudrate else 0.0
