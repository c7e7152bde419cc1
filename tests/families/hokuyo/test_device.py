"""What a device says of itself, in words, and on a poor line: each scan is one packet that a lost byte damages."""

import re

import pytest

from lidario import LidarError, RemoteProtocolError, ResponseTimeout, open_lidar
from lidario.basics.model import Health, HealthStatus
from lidario.families.hokuyo.commands import check_of, read_lines
from lidario.families.hokuyo.device import FORMATS, HokuyoDevice, mode_for
from lidario.families.hokuyo.simulated import pack_lines
from lidario.testing import SimulatedLidar
from lidario.wire.envelope import Request
from tests.families.hokuyo.about import GEOMETRY
from tests.support.devices import left_still, make_rig, take
from tests.support.loop import now
from tests.support.scripts import played

STATES = {
    "Sensor works well.": Health(HealthStatus.OK, 0),
    "Stable 000 no error.": Health(HealthStatus.OK, 0),
    # A UST-20LX (ros-drivers/urg_node #6), and a UTM-30LX in need of a restart (jsk-ros-pkg/jsk_robot #873).
    "sensor is working normally": Health(HealthStatus.OK, 0),
    "Trouble!! Error No. =[00->33]": Health(HealthStatus.ERROR, 33, "it says: Trouble!! Error No. =[00->33]"),
    # The vendor counts these as stable (UrgNetwork/urg_library #26): it measures, and something is to be told.
    "failed to synchronize": Health(HealthStatus.WARNING, 0, "it says: failed to synchronize"),
    "working abnormally": Health(HealthStatus.WARNING, 0, "it says: working abnormally"),
    "malfunction 32": Health(HealthStatus.ERROR, 32, "it says: malfunction 32"),
    "Internal failure": Health(HealthStatus.ERROR, 0, "it says: Internal failure"),
    "Warming up 7": Health(HealthStatus.WARNING, 7, "it says: Warming up 7"),
    "Warming up": Health(HealthStatus.WARNING, 0, "it says: Warming up"),
}


@pytest.mark.parametrize("state", STATES)
def test_its_health_is_told_in_words(state: str) -> None:
    response = pack_lines(b"II", [f"STAT:{state}"], counts_semicolon=False)
    payload = response.removeprefix(b"II\n").removesuffix(b"\n\n")
    assert played(HokuyoDevice().health(), lambda _: payload) == STATES[state]


# What devices responded, in transcripts of their users: an URG-04LX-UG01 to VV, an URG-04LX to PP and II, and a
# UTM-30LX-EW to PP.
TOLD = {
    "URG-04LX-UG01": "VEND:Hokuyo Automatic Co.,Ltd.;[ PROD:SOKUIKI Sensor URG-04LX-UG01(Simple-URG);[ "
    "FIRM:3.4.03(17/Dec./2012);T PROT:SCIP 2.0;N SERI:H1510998;V",
    "URG-04LX": "MODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N DMIN:20;4 DMAX:5600;_ ARES:1024;\\ AMIN:44;7 "
    "AMAX:725;o AFRT:384;6 SCAN:600;e",
    "its state": "LASR:OFF;7 SCSP:Initial(600[rpm])<-Default setting by user;A MESM:IDLE;: "
    "SBPS:19200[bps]<-Default setting by user;A TIME:081615;N STAT:Sensor works well.;8",
    "UTM-30LX-EW": "MODL:UTM-30LX-EW;I DMIN:23;7 DMAX:60000;J ARES:1440;^ AMIN:0;? AMAX:1080;Z AFRT:540;0 "
    "SCAN:2400;U",
}


@pytest.mark.parametrize("text", TOLD.values(), ids=TOLD)
def test_what_real_devices_told_is_read(text: str) -> None:
    lines_ = re.split(r" (?=[A-Z]{4}:)", text)
    told = read_lines("\n".join(("00P", *lines_)).encode())
    assert told is not None
    assert [f"{name}:{value}" for name, value in told.lines.items()] == [line[:-2] for line in lines_]


@pytest.mark.parametrize("model", ["URG-04LX", "UBG-04LX-F01", "UHG-08LX", "UTM-30LX"])
def test_an_old_model_is_not_asked_for_intensities(model: str) -> None:
    """The SCIP 2.0 specification of the first three has no ME; of an URG-04LX it is known that it may hang."""
    device = HokuyoDevice()
    modes = played(
        device.modes(), lambda request: lines(**FIELD | {"MODL": model}) if b"PP" in request.data else WELL
    )
    assert len(modes) == (2 if model == "UTM-30LX" else 1)


def test_it_measures_distances_alone_where_nothing_else_is_asked_for() -> None:
    modes = [mode_for(wire, GEOMETRY) for wire in FORMATS]
    assert [(mode.name, mode.typical) for mode in modes] == [("Standard", True), ("Intensity", False)]


@pytest.mark.long
@pytest.mark.parametrize("model", ["hokuyo-urg04lx", "hokuyo-utm30lx"])
async def test_many_damaged_scans_in_a_row_do_not_end_a_stream(model: str) -> None:
    """Two of three scans are damaged, or more, where each is one packet of two thousand bytes."""
    device = SimulatedLidar(model, fault="drop:0.05%")
    async with open_lidar(device) as lidar:
        assert len(await take(lidar, 100)) == 100


def lines(**fields: object) -> bytes:
    """A response as it stands behind the echo: a status and the fields, each line with its check character."""
    told = [f"{name}:{value};".encode() for name, value in fields.items()]
    return b"\n".join(line + bytes((check_of(line),)) for line in (b"00", *told))


WELL = lines(PROD="URG")
FIELD: dict[str, object] = {
    "MODL": "URG-04LX", "DMIN": 20, "DMAX": 5600, "ARES": 1024, "AMIN": 44, "AMAX": 725, "AFRT": 384, "SCAN": 600,
}  # fmt: skip


@pytest.mark.parametrize("spoilt", [0, 1, 2])
def test_a_field_that_cannot_be_is_asked_for_again(spoilt: int) -> None:
    """One damaged line in 64 passes for a whole one."""
    fields = iter([lines(**FIELD | {"AMIN": 900})] * spoilt + [lines(**FIELD)])
    asked = 0

    def answer(request: Request) -> bytes:
        nonlocal asked
        asked += b"PP" in request.data
        return next(fields) if b"PP" in request.data else WELL

    if spoilt == 2:
        with pytest.raises(RemoteProtocolError, match=r"cannot be: .*AMIN:900"):
            played(HokuyoDevice().identify(), answer)
    else:
        assert played(HokuyoDevice().identify(), answer).model == "Hokuyo URG-04LX"
    assert asked == min(1 + spoilt, 2)


@pytest.mark.parametrize(("rpm", "slowest_s"), [(2400, 1.0), (600, 1.0), (60, 1.5)])
def test_a_revolution_may_take_half_as_long_again_as_it_says_and_a_second(rpm: int, slowest_s: float) -> None:
    device, field = HokuyoDevice(), lines(**FIELD | {"SCAN": rpm})
    mode = played(device.modes(), lambda request: field if b"PP" in request.data else WELL)[0]
    assert played(device.start(mode), lambda _: bytes((mode.response_type,))).slowest_turn_s == slowest_s


@pytest.mark.parametrize(
    ("state", "raised"), [("Sensor works well.", RemoteProtocolError), ("malfunction 32", ResponseTimeout)]
)
def test_a_refused_start_of_a_device_that_is_not_well_is_as_none(state: str, raised: type[LidarError]) -> None:
    """Then it is asked what is wrong, and reset."""
    device = HokuyoDevice()
    modes = played(device.modes(), lambda request: lines(**FIELD) if b"PP" in request.data else WELL)

    def answer(request: Request) -> bytes:
        return lines(STAT=state) if b"II" in request.data else b"10Q"

    with pytest.raises(raised):
        played(device.start(modes[0]), answer)


async def test_it_is_closed_without_a_pause_and_can_be_opened_again_at_once() -> None:
    """It acknowledges QT, and hears what comes behind it."""
    rig = make_rig("hokuyo-urg04lx")
    for _ in range(2):
        async with rig.read():
            began = now()
        assert now() - began < 0.25
        assert left_still(rig)
