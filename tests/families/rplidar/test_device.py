"""The scripts of an RPLIDAR, driven by hand: what it is, how it is started, and at which speed."""

import struct

import pytest

from lidario.basics.model import Health, HealthStatus, SampleRate, ScanMode
from lidario.errors import InvalidValue, RemoteProtocolError, Unsupported
from lidario.families.base import Stream
from lidario.families.rplidar.commands import Conf
from lidario.families.rplidar.device import RplidarDevice
from tests.support.rplidar_device import A1, DENSE_BOOST, S2, STANDARD, conf, identified, info
from tests.support.scripts import Answers, drive

# -------------------------------------------------------------------------------------------------- identity


def test_an_identity_that_is_never_the_same_is_refused() -> None:
    script = RplidarDevice().identify()
    next(script)
    with pytest.raises(RemoteProtocolError, match="all different"):
        for number in range(9):
            script.send(bytes((number,)) * 20)
    assert number == 4


@pytest.mark.parametrize(
    ("model", "name"),
    [
        *((0x18, "A1M8"), (0x28, "A2M8"), (0x31, "A3M1"), (0x41, "C1M1"), (0x61, "S1M1")),
        *((0x71, "S2M1"), (0x82, "S3M2"), (0x91, "T1M1"), (0xC0, "M1M0"), (0xFF, "M4M15")),
        (0x07, "(model 0x07)"),
    ],
)
def test_model_names(model: int, name: str) -> None:
    found, _ = drive(RplidarDevice().identify(), {b"\xa5\x50": info(model, (1, 2))})
    assert (found.model, found.firmware) == (f"RPLIDAR {name}", "1.02")


@pytest.mark.parametrize(
    ("address", "name"), [(None, "S2M1"), (b"", "S2M1"), (bytes(range(6)), "S2E")], ids=["silent", "none", "one"]
)
def test_an_s2_that_tells_an_ethernet_address_is_an_s2e(address: bytes | None, name: str) -> None:
    """A response that tells no more than what was asked for tells no address."""
    device = RplidarDevice()
    device.baudrate = 0
    found, _ = drive(device.identify(), {b"\xa5\x50": info(S2), **conf(Conf.MAC_ADDRESS, address)})
    assert found.model == f"RPLIDAR {name}"


@pytest.mark.parametrize(
    ("payload", "health"),
    [
        (b"\0\0\0", Health(HealthStatus.OK, 0)),
        (b"\x01\x02\x01", Health(HealthStatus.WARNING, 0x0102)),
        (b"\x02\xff\xff", Health(HealthStatus.ERROR, 0xFFFF)),
    ],
)
def test_health(payload: bytes, health: Health) -> None:
    assert drive(RplidarDevice().health(), {b"\xa5\x52": payload})[0] == health


def test_sample_rate() -> None:
    rate, _ = drive(identified().sample_rate(), {b"\xa5\x59": struct.pack("<HH", 62, 31)})
    assert rate == SampleRate(62.0, 31.0)
    old, sent = drive(identified(A1, (1, 16)).sample_rate(), {})
    assert (old, sent) == (SampleRate(476.0, 476.0), [])
    _, sent = drive(identified(A1, (1, 17)).sample_rate(), {b"\xa5\x59": struct.pack("<HH", 508, 254)})
    assert [request.name for request in sent] == ["GET_SAMPLERATE"] * 2


# ----------------------------------------------------------------------------------------------------- start


def started(device: RplidarDevice, mode: ScanMode, answers: Answers, *, force: bool = False) -> tuple[Stream, str]:
    stream, sent = drive(device.start(mode, force=force), answers)
    return stream, " ".join(request.data.hex() for request in sent if request.data[1] not in (0x84, 0x59))


@pytest.mark.parametrize("force", [False, True])
def test_starting_a_plain_scan(force: bool) -> None:
    stream, sent = started(identified(), STANDARD, {}, force=force)
    # The speed of its choice is not told: 600 turns a minute.
    assert sent == f"a5a802580255 a5{21 if force else 20}"
    assert stream.format.response_type == 0x81


def test_zero_microseconds_are_asked_for_in_the_older_way() -> None:
    mode = ScanMode(1, "DenseBoost", 0.0, 30.0, 0x85)
    rates = {b"\xa5\x59": struct.pack("<HH", 63, 31)}
    assert started(identified(), mode, rates)[0].sample_ns == 31000.0
    assert started(identified(), ScanMode(0, "S", 0.0, 30.0, 0x81), rates)[0].sample_ns == 63000.0
    # Silence, or 0 again: it is measured from the stream.
    assert started(identified(), mode, {})[0].sample_ns == 0.0
    assert started(identified(), mode, {b"\xa5\x59": bytes(4)})[0].sample_ns == 0.0


def test_what_cannot_be_started_is_refused_before_anything_is_sent() -> None:
    device = identified()
    with pytest.raises(Unsupported, match="'Newest' sends response type 0x87; lidario knows 0x81, 0x82"):
        next(device.start(ScanMode(2, "Newest", 31.25, 30.0, 0x87)))
    with pytest.raises(Unsupported, match="'DenseBoost' is none"):
        next(device.start(DENSE_BOOST, force=True))


# ----------------------------------------------------------------------------------------------------- speed

LIMITS = {**conf(Conf.MIN_ROTATION, struct.pack("<H", 480)), **conf(Conf.MAX_ROTATION, struct.pack("<H", 1200))}


@pytest.mark.parametrize("hertz", [8.0, 10.0, 12.34, 20.0])
def test_setting_the_scan_frequency(hertz: float) -> None:
    device = identified()
    reached, _ = drive(device.set_scan_frequency(hertz), LIMITS)
    assert reached == pytest.approx(hertz, abs=1 / 120)
    assert drive(device.scan_frequency(), {})[0] == reached
    rpm = round(hertz * 60)
    _, sent = started(device, STANDARD, {})
    assert sent.startswith(f"a5a802{rpm & 0xFF:02x}{rpm >> 8:02x}")


@pytest.mark.parametrize("hertz", [7.9, 20.1, 0.0, -10.0, 1e308, -1e308])
def test_a_frequency_beyond_the_devices_limits_is_refused(hertz: float) -> None:
    device = identified()
    with pytest.raises(InvalidValue, match="rpm"):
        drive(device.set_scan_frequency(hertz), LIMITS)
    assert drive(device.scan_frequency(), {})[0] == 10.0


def test_without_told_limits_what_fits_the_request_is_tried() -> None:
    device = identified()
    assert drive(device.set_scan_frequency(1000.0), {})[0] == 1000.0
    for hertz in (0.0, 2000.0):
        with pytest.raises(InvalidValue, match="1 to 65535 rpm"):
            drive(device.set_scan_frequency(hertz), {})
