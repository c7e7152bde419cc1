"""Sources, taken apart."""

from __future__ import annotations

import pytest

from lidario import ConnectFailed, open_lidar
from lidario.source import Source, parse_source


@pytest.mark.parametrize(
    ("text", "kind", "address", "options"),
    [
        ("auto", "auto", "", {}),
        ("", "auto", "", {}),
        ("/dev/ttyUSB0", "serial", "/dev/ttyUSB0", {}),
        ("COM3", "serial", "COM3", {}),
        ("/dev/serial/by-id/usb-A_b-if00-port0", "serial", "/dev/serial/by-id/usb-A_b-if00-port0", {}),
        (
            "serial:///dev/ttyUSB0?baud=1000000&family=x",
            "serial",
            "/dev/ttyUSB0",
            {"baud": "1000000", "family": "x"},
        ),
        ("id:ABCDEF01", "id", "ABCDEF01", {}),
        ("tcp://192.168.0.7:20108", "tcp", "192.168.0.7:20108", {}),
        ("socket://[::1]:2000", "tcp", "[::1]:2000", {}),
        ("sim://model-2?world=room&fault=drop:1%25,flip:0.1%25", "sim", "model-2", None),
        ("sim://model-2?fault=drop:1%", "sim", "model-2", {"fault": "drop:1%"}),
    ],
)
def test_sources(text: str, kind: str, address: str, options: dict[str, str] | None) -> None:
    source = parse_source(text)
    assert (source.kind, source.address) == (kind, address)
    if options is None:
        assert source.options == {"world": "room", "fault": "drop:1%,flip:0.1%"}
    else:
        assert source.options == options


def test_what_a_source_says() -> None:
    source = parse_source("serial:///dev/x?baud=512000&family=some")
    assert (source.baudrate, source.family) == (512000, "some")
    assert parse_source("/dev/x").baudrate is None
    assert parse_source("tcp://[::1]:2000").host_and_port == ("::1", 2000)
    assert Source("x", "serial", "x").options == {}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("http://example", "http:// is not known"),
        ("sim://m?speed=3", "does not know: speed"),
        ("serial:///dev/x?baud=fast", "not a number"),
        ("serial:///dev/x?baud=0", "not a number"),
        ("serial://", "names nothing"),
        ("tcp://host", "host and a port"),
        ("tcp://host:port", "host and a port"),
        ("sim://", "names nothing"),
    ],
)
def test_what_is_no_source_says_why(text: str, says: str) -> None:
    with pytest.raises(ConnectFailed, match=says) as caught:
        parse_source(text)
    assert caught.value.reason == "source"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("sim://rplidar-s9", "rplidar-s2"),
        ("sim://rplidar-s2?world=moon", "room"),
        ("sim://rplidar-s2?fault=gremlins", "gremlins"),
        ("sim://rplidar-s2?via=pigeon", "memory"),
        ("sim://rplidar-s2?serial=xyz", "hex"),
        ("serial:///dev/null?family=hokuyo", "hokuyo"),
    ],
)
async def test_what_is_wrong_with_a_source_is_said_when_it_is_opened(text: str, says: str) -> None:
    with pytest.raises(ConnectFailed, match=says) as caught:
        await open_lidar(text)
    assert caught.value.reason == "source"
