"""What a device says of itself, and what a session has counted: plain records."""

import math
from dataclasses import dataclass
from enum import Enum
from operator import add, sub
from typing import Self

from lidario.basics.words import counted


class HealthStatus(Enum):
    """How the device judges its own state."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Health:
    """Response to a health request.

    Attributes:
        status: ``ERROR`` means the device protects itself and will not scan.
        code: The device's error code; the vendors do not publish what the codes mean.
        note: What is unusual about the response, or its absence, for people; mostly empty.
    """

    status: HealthStatus
    code: int
    note: str = ""

    @property
    def ok(self) -> bool:
        """Whether the device will scan."""
        return self.status is not HealthStatus.ERROR


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """What the device says it is.

    Attributes:
        family: Name of the protocol family in lidario.
        model: Model name, derived from the model number.
        model_id: The model number as the device sent it.
        firmware: ``major.minor``.
        hardware: Hardware revision.
        serial: Serial number, in the notation the vendor's own programs print.
    """

    family: str
    model: str
    model_id: int
    firmware: str
    hardware: int
    serial: str


@dataclass(frozen=True, slots=True)
class SampleRate:
    """Time a sample takes.

    Attributes:
        standard_us: Microseconds a sample in the standard mode.
        express_us: Microseconds a sample in the express mode.
    """

    standard_us: float
    express_us: float


@dataclass(frozen=True, slots=True)
class NetworkAddress:
    """Where an Ethernet model is found in its network; IPv4, as in ``"192.168.11.2"``.

    Attributes:
        address: Its own address; ``"0.0.0.0"`` where it asks the network for one (DHCP).
        mask: Mask of its network.
        gateway: Gateway of its network.
    """

    address: str
    mask: str = "255.255.255.0"
    gateway: str = "0.0.0.0"


@dataclass(frozen=True, slots=True)
class ScanMode:
    """One way in which the device can measure.

    Attributes:
        id: The device's number for it; numbers differ from model to model.
        name: The device's name for it.
        sample_us: Microseconds a sample; 0 when the device does not say.
        max_distance: Farthest distance in metres; 0 when the device does not say.
        response_type: Type byte of the stream it sends.
        typical: Whether the device recommends it.
        details: What the device told that its packets cannot be decoded without, for recordings; mostly empty.
    """

    id: int
    name: str
    sample_us: float
    max_distance: float
    response_type: int
    typical: bool = False
    details: str = ""

    @property
    def samples_per_second(self) -> float:
        """Samples a second; NaN when the device does not say."""
        return 1e6 / self.sample_us if self.sample_us else math.nan


@dataclass(frozen=True, slots=True)
class LineErrors:
    """What a driver has counted as wrong; `Stats` tells what each means."""

    framing: int = 0
    parity: int = 0
    overruns: int = 0
    breaks: int = 0

    def __add__(self, other: Self) -> Self:
        """The sums, such as of two lines."""
        return type(self)(*map(add, self._counts, other._counts))

    def __sub__(self, before: Self) -> Self:
        """What was counted since `before`."""
        return type(self)(*map(sub, self._counts, before._counts))

    @property
    def _counts(self) -> tuple[int, int, int, int]:
        # `astuple` copies each of them, which takes 20 us where it is done once in a while.
        return self.framing, self.parity, self.overruns, self.breaks

    def meaning(self) -> str:
        """What was counted, and what it is mostly a sign of; empty where nothing was counted."""
        names = ((self.framing, "framing error"), (self.parity, "parity error"), (self.breaks, "break"))
        told = [counted(count, name) for count, name in names if count]
        parts = [", ".join(told) + ": the baud rate is wrong or the cable is bad"] if told else []
        if self.overruns:
            parts.append(f"{counted(self.overruns, 'overrun')}: this computer is too slow for the line")
        return "; ".join(parts)


@dataclass(frozen=True, slots=True)
class Stats:
    """Counters of one session since it was opened; a snapshot.

    Two sums close at any time, whatever was damaged or lost: each received byte is counted in exactly one of
    `packet_bytes`, `record_bytes`, `skipped_bytes`, `response_bytes`, `stray_bytes`, `drained_bytes`,
    `discarded_bytes` and `buffered`; each packet in exactly one of `scan_packets`, `discarded_packets`,
    `doubled_packets`, `false_packets` and `unfinished_packets`.

    Attributes:
        bytes_received: All bytes that came in.
        packets: Intact measurement packets.
        packet_bytes: Their bytes.
        lost_packets: Packets known to be missing: from the jump in the angle, and from the time where whole
            revolutions are missing.
        scan_packets: Packets of the scans that were delivered.
        discarded_packets: Packets of revolutions that were not delivered: broken ones, the parts of a revolution at
            the beginning and the end of a stream, and packets that no stream had asked for.
        doubled_packets: Packets that came once more, right behind themselves, and were dropped.
        false_packets: Noise that passed for a packet, as its angle shows: it was dropped.
        unfinished_packets: Packets of the revolution in the making.
        records: Known records between packets that carry no measurement.
        record_bytes: Their bytes.
        skipped_bytes: Bytes of a stream that belong to no packet.
        skipped_stretches: Stretches of such bytes.
        response_bytes: Responses that were waited for, and what announces a stream.
        stray_bytes: Bytes outside a stream that are no response.
        drained_bytes: Bytes discarded after a STOP: what the device had still to send.
        discarded_bytes: Bytes that were received and discarded unparsed, because the program was too slow.
        late_reads: Reads that found the system's buffer full, because this computer was too busy: what is missing
            then was lost here, and not on the line.
        framing_errors: Bytes that did not end where a byte must end, as the driver of the serial port has counted
            them: the baud rate is wrong or the cable is bad. Not every driver counts, so that a zero says little;
            see `docs/troubleshooting.md`. The same holds for the next three.
        parity_errors: Bytes of the wrong parity; lidars send none.
        overruns: Times bytes were lost because nobody took them in time: this computer is too slow for the line.
        breaks: Times the line was low for longer than a byte lasts: the baud rate is wrong, or a wire is loose.
        buffered: Bytes received that belong to nothing complete yet.
        late_responses: Responses to an earlier request, discarded.
        scans: Full revolutions.
        broken_scans: Revolutions discarded because so much of them was missing that they could not be told apart.
        missed_scans: Revolutions missing between the scans, by which `Scan.seq` jumps: broken ones, those of
            which nothing came, and, by the speed before, those that passed while the device was away
            (`reconnects`). What passes while the stream is interrupted is not counted.
        dropped_scans: Scans that slow readers missed, summed over all readers.
        interruptions: Times a stream was stopped for a request and started again.
        keepalives: Keepalive requests sent.
        restarts: Times a stream that had stopped by itself was started again.
        protection_stops: Times the device was found to have stopped to protect itself, also when it was opened. It
            was reset then; several may be a sign of lasting damage.
        reconnects: Times the session has found its device again after it had lost it.
    """

    bytes_received: int = 0
    packets: int = 0
    packet_bytes: int = 0
    lost_packets: int = 0
    scan_packets: int = 0
    discarded_packets: int = 0
    doubled_packets: int = 0
    false_packets: int = 0
    unfinished_packets: int = 0
    records: int = 0
    record_bytes: int = 0
    skipped_bytes: int = 0
    skipped_stretches: int = 0
    response_bytes: int = 0
    stray_bytes: int = 0
    drained_bytes: int = 0
    discarded_bytes: int = 0
    late_reads: int = 0
    framing_errors: int = 0
    parity_errors: int = 0
    overruns: int = 0
    breaks: int = 0
    buffered: int = 0
    late_responses: int = 0
    scans: int = 0
    broken_scans: int = 0
    missed_scans: int = 0
    dropped_scans: int = 0
    interruptions: int = 0
    keepalives: int = 0
    restarts: int = 0
    protection_stops: int = 0
    reconnects: int = 0

    @property
    def line_trouble(self) -> str:
        """What the driver has counted, with what it is mostly a sign of; empty where it has counted nothing."""
        return LineErrors(self.framing_errors, self.parity_errors, self.overruns, self.breaks).meaning()
