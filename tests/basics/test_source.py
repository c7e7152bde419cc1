"""Sources, taken apart."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidario import ConnectFailed, InvalidValue, open_lidar
from lidario.basics.source import as_source, parse_source
from lidario.families.registry import check_source
from lidario.port.simulated import make_device
from tests.support.refused import refused


@pytest.mark.parametrize(
    ("text", "kind", "address", "options"),
    [
        ("auto", "auto", "", {}),
        ("", "auto", "", {}),
        ("/dev/ttyUSB0", "serial", "/dev/ttyUSB0", {}),
        ("COM3", "serial", "COM3", {}),
        ("/dev/serial/by-id/usb-A_b-if00-port0", "serial", "/dev/serial/by-id/usb-A_b-if00-port0", {}),
        ("serial:///dev/ttyUSB0?baud=9600&family=x", "serial", "/dev/ttyUSB0", {"baud": "9600", "family": "x"}),
        ("file:///home/me/two%20rooms.mcap?rate=2", "file", "/home/me/two rooms.mcap", {"rate": "2"}),
        ("id:ABCDEF01", "id", "ABCDEF01", {}),
        ("tcp://192.168.0.7:20108", "tcp", "192.168.0.7:20108", {}),
        ("socket://[::1]:2000", "tcp", "[::1]:2000", {}),
        ("udp://192.168.11.2:8089", "udp", "192.168.11.2:8089", {}),
        ("udp://[::1]:8089?family=x", "udp", "[::1]:8089", {"family": "x"}),
        (
            "sim://m-2?world=room&fault=drop:1%25,flip:1%25",
            "sim",
            "m-2",
            {"world": "room", "fault": "drop:1%,flip:1%"},
        ),
        ("sim://model-2?fault=drop:1%", "sim", "model-2", {"fault": "drop:1%"}),
        ("zenoh:robots/r7/scan", "zenoh", "robots/r7/scan", {}),
        ("zenoh:robots/*/scan?router=tls/fleet:7447", "zenoh", "robots/*/scan", {"router": "tls/fleet:7447"}),
        ("zenoh://0/scan/msg::dds_::LaserScan_/**", "zenoh", "0/scan/msg::dds_::LaserScan_/**", {}),
        # Forms that are easily meant.
        ("serial://COM3?baud=115200", "serial", "COM3", {"baud": "115200"}),
        ("serial:///dev/tty#1", "serial", "/dev/tty#1", {}),
        ("SIM://model-2", "sim", "model-2", {}),
        (Path("/dev/ttyUSB0"), "serial", "/dev/ttyUSB0", {}),
    ],
)
def test_sources(text: str | Path, kind: str, address: str, options: dict[str, str]) -> None:
    source = as_source(text)
    assert (source.kind, source.address, source.options) == (kind, address, options)
    assert source.text == (str(text) or "auto")


# ------------------------------------------------------------------------------ whatever text is given


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("http://example", "http:// is not known"),
        ("sim://m?speed=3", "does not know: 'speed'"),
        ("serial:///dev/x?baud=fast", "not a number"),
        ("serial:///dev/x?baud=0", "not a number"),
        ("serial://", "names nothing"),
        ("tcp://host", "host and a port"),
        ("tcp://host:port", "host and a port"),
        ("udp://host", "host and a port, as in udp://192.168.11.2:8089"),
        ("udp://host:8089?baud=115200", "does not know: 'baud'"),
        ("zenoh:", ""),
        ("zenoh:a?port=3", ""),
        ("zenoh:a\nb", ""),
        ("tcp://[", "cannot be read"),
        ("tcp://a..b:80", "host name"),
        ("tcp://" + "a" * 64 + ":80", "host name"),
        ("tcp://a%00b:80", "control character"),
        ("tcp://host:65536", "host and a port"),
        ("tcp://host:0", "host and a port"),
        ("tcp://host:²", "host and a port"),
        ("tcp://user@host:80", "host and a port"),
        ("tcp://host:80/path", "nothing may follow"),
        ("sim://m/path", "nothing may follow"),
        ("serial:///dev/x?baud=²", "not a number"),
        ("serial:///dev/x?baud=" + "9" * 5000, "not a number"),
        ("serial:///dev/x?baud=", "not a number"),
        ("serial:///dev/x?baud=1&baud=2", "given twice"),
        ("serial://dev/ttyUSB0", "three slashes"),
        ("file://home/run.mcap", "three slashes"),
        ("sim://m?seed=-1", "seed"),
        ("sim://m?seed=²", "seed"),
        ("/dev/\0x", "control character"),
        ("serial:///dev/%00x", "control character"),
        ("/dev/\ud800", "file name"),
        ("id:", "names nothing"),
        ("id:\x1b[2J", "control character"),
    ],
)
def test_what_is_no_source_says_why(text: str, says: str) -> None:
    with refused("source") as caught:
        parse_source(text)
    assert says in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("text", ["zenoh:räume/lidar", "tcp://bücher.example:80", "id:Ä1"])
def test_only_names_of_files_need_the_encoding_of_file_names(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is ASCII where the system knows no other locale."""
    monkeypatch.setattr(os, "fsencode", lambda name: name.encode("ascii", "surrogateescape"))
    assert parse_source(text).text == text
    with pytest.raises(ConnectFailed, match="file name"):
        parse_source("/dev/räume")
    with pytest.raises(ConnectFailed, match="no character"):
        parse_source("zenoh:\udcff")


WORDS = "auto :// // %00 %5B %3A .. . baud= family= seed= world= fault= tcp:// serial:// sim:// id: 80 65536 ::1"
PIECES = st.sampled_from([*":/?&=#@[]%²٣\0\n\x1b\ud800\udc80ßa", *WORDS.split()])
TEXTS = st.one_of(st.text(), st.lists(PIECES, max_size=9).map("".join), st.text().map("tcp://{}:80".format))


@settings(max_examples=settings().max_examples * 5)
@given(TEXTS)
def test_any_text_is_a_source_or_is_refused(text: str) -> None:
    try:
        source = parse_source(text)
        check_source(source)
    except ConnectFailed as error:
        refused = error
        source = None
    if source is None:
        assert refused.reason == "source"
        assert str(refused).replace("\n", "").isprintable()
        return
    assert source.kind in ("auto", "serial", "id", "tcp", "sim")
    assert source.baudrate is None or 0 < source.baudrate <= 100_000_000
    encode = os.fsencode if source.kind == "serial" else str.encode
    encode(source.address)
    assert "\0" not in source.address
    if source.kind == "tcp":
        host, port = source.host_and_port
        assert 0 < port < 0x10000
        assert host.encode("idna")


# ------------------------------------------------------------------------------ names that must be known


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("serial:///dev/null?family=velodyne", "'velodyne'(.|\n)*rplidar, ydlidar"),
        ("tcp://host:80?family=", "''(.|\n)*rplidar, ydlidar"),
        ("sim://", "name a model(.|\n)*rplidar-s2(.|\n)*ydlidar-4ros"),
        ("sim://rplidar-s9", "'rplidar-s9'.*rplidar-s2"),
        ("sim://nonesuch", "'nonesuch'(.|\n)*rplidar-s2(.|\n)*ydlidar-4ros"),
        ("sim://ydlidar-4ros?family=rplidar", "ydlidar-4ros.*'ydlidar'"),
        ("sim://rplidar-s2?model=x2", "no model 'x2'"),
        *((f"serial:///dev/x?{named}", "ld06") for named in ("model=ld60", "family=ldrobot&model=tx8")),
    ],
)
def test_unknown_names_are_told_before_anything_is_opened(text: str, says: str) -> None:
    with refused("source", says):
        open_lidar(text)


@pytest.mark.parametrize(
    "form", ["sim://{}", "tcp://h:80?family={}", "sim://rplidar-s2?world={}", "sim://rplidar-s2?fault={}", "{}://"]
)
def test_a_long_unprintable_word_makes_no_long_text(form: str) -> None:
    with refused("source") as caught:
        check_source(parse_source(form.format("\udcff" * 5000)))
        make_device(parse_source(form.format("\udcff" * 5000)))
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize(
    ("text", "own"), [("sim://ydlidar-4ros", "ydlidar"), ("serial:///dev/null?family=ldrobot", "ldrobot")]
)
def test_a_family_given_beside_the_source_must_be_that_of_the_source(text: str, own: str) -> None:
    with pytest.raises(InvalidValue, match=f"'rplidar'.*{text[:12]}.*{own}"):
        open_lidar(text, family="rplidar")
    open_lidar(text, family=own)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("sim://rplidar-s2?world=moon", "room"),
        ("sim://rplidar-s2?fault=gremlins", "gremlins"),
        ("sim://rplidar-s2?via=pigeon", "is not pty, tcp"),
        ("sim://rplidar-s2?serial=xyz", "is written in hexadecimal digits, not 'xyz'"),
        *((text, "is not|has a part") for text in ("zenoh:a b", "zenoh:@x", "zenoh:a?router=x")),
        *((f"zenoh:a?router=tcp/{where}", "is not|has a part") for where in ("[::1]", "b:99999")),
    ],
)
async def test_what_is_wrong_with_a_source_is_said_when_it_is_opened(text: str, says: str) -> None:
    with refused("source", says):
        await open_lidar(text)
