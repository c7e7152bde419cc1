"""What cannot be meant is refused in a sentence that says why, with exit code 2, and nothing is made."""

import shlex
from pathlib import Path

import pytest

from lidario.cli.plot import plot
from lidario.cli.publish import publish
from lidario.cli.record import record
from lidario.cli.scan import scan
from lidario.cli.stats import stats
from lidario.cli.view import view
from lidario.cli.watch import watch
from tests.cli.processes import invoke_driven

S2 = "sim://rplidar-s2?via=memory"
RECORD = "record /dev/nothing-is-here"
"""What is refused before a lidar is opened."""
REMOTE = "zenoh:robots/r7/scan?router=tcp/127.0.0.1:1"
REFUSED = {
    "nosuchverb": "no such command 'nosuchverb'",
    "scan --nosuchoption": "no such option",
    "scan -n -1": "-1 is not in the range x>=0",
    "scan -n many": "'many' is not a valid whole number",
    "scan --json --csv": "--json and --csv exclude each other",
    "scan a b": "unexpected extra argument (b)",
    f"scan {S2} --config ''": "a file of settings",
    f"view {S2} --port 0 --config ''": "a file of settings",
    "scan sim:rplidar-s2": "two slashes, as in sim://rplidar-s2",
    f"scan {S2} --mode nosuchmode": "no scan mode 'nosuchmode'",
    f"scan {S2} --mode 77": "no scan mode 77",
    "info nosuch://thing": "nosuch:// is not known",
    "info sim://nosuchmodel": "no simulated lidar 'nosuchmodel'",
    "info sim://rplidar-s2?nosuch=1": "does not know: 'nosuch'",
    **{
        f"devices {name}": f"'{name}' is no port: `lidario info {name}`"
        for name in ("sim://rplidar-s2", "tcp://192.168.0.7:20108", "a.mcap", "id:AB12")
    },
    "devices --router tcp/192.168.0.2:7447": "--router belongs to --zenoh",
    "motor": "lidario motor start, lidario motor stop, lidario motor speed",
    "motor speed fast": "'fast' is not a valid number",
    f"motor speed -- 0 {S2}": "0.0 is not in the range x>0",
    f"motor speed -- -3 {S2}": "-3.0 is not in the range x>0",
    f"motor speed 1000 {S2}": "outside of this device's 8 to 20 Hz",
    f"motor start {REMOTE}": "the motor of another machine's lidar cannot be switched from here",
    f"motor stop {REMOTE}": "the motor of another machine's lidar cannot be switched from here",
    f"motor speed 7 {REMOTE}": "the motor of another machine's lidar cannot be switched from here",
    "sim nosuchmodel": "no simulated lidar 'nosuchmodel'",
    "sim --pty --tcp :0": "exclude each other",
    "sim --udp :0 --tcp :0": "exclude each other",
    "sim --tcp nonsense": "--tcp: 'nonsense' is not [HOST]:PORT",
    "sim --tcp :99999": "--tcp: ':99999' is not [HOST]:PORT",
    "sim --udp 8089x": "--udp: '8089x' is not [HOST]:PORT",
    "sim --tcp ü..x:0": "--tcp: 'ü..x:0' is not [HOST]:PORT",
    "sim --udp ü..x:0": "--udp: 'ü..x:0' is not [HOST]:PORT",
    "sim --fault reboots:5s": "no fault is called 'reboots'; there are drop, ",
    "sim --world nosuchworld": "no world is called 'nosuchworld'",
    "sim --serial xyz": "in hexadecimal digits, not 'xyz'",
    "sim --serial 00": "16 bytes, not 1",
    "completion cmd": "'cmd' is not one of 'bash', 'zsh', 'fish'",
    "watch sim://rplidar-s2": "stdout is none; `lidario scan -n 0`",
    "udev --name=../sda": "'../sda' cannot be the name of a device",
    "udev '--name=a b'": "'a b' cannot be",
    "udev '--name=a\"'": "'a\"' cannot be",
    "udev --name=": "'' cannot be",
    "udev --name=-x": "'-x' cannot be",
    f"record {S2} -n 1 -o x.txt": "'x.txt' does not end in .mcap",
    f"record {S2} -n 1 -o x": "'x' does not end in .mcap",
    f"record {S2} -n 1 -o ''": "'' does not end in .mcap",
    f"record {S2} -n 0": "0 is not in the range x>=1",
    f"record {S2} -t soon": "'soon' is not a duration above 0",
    f"record {S2} -o a.mcap --split 5": "neither a time nor a size",
    f"record {S2} -o a.mcap --split 5s --keep 20": "is not a size",
    f"{RECORD} --split 0s": "--split is 1 to 1000000000 seconds, not 0.0",
    f"{RECORD} --split 999999999h": "--split is 1 to 1000000000 seconds, not 3599999996400.0",
    f"{RECORD} --split 1kb": "--split is 100000 bytes or more, not 1000",
    f"{RECORD} --split 1m --keep 1kb": "--keep is 200000 bytes or more, two files, not 1000",
    f"{RECORD} --keep 1GB": "--keep removes whole files: --split says when the next one begins",
    f"{RECORD} -o q?.mcap": "'q?.mcap' means something else as a SOURCE: give the file another name",
    f"{RECORD} -o a.mcap?rate=1.mcap": "rate='1.mcap' is not a number from 0 on",
    f"{RECORD} -o id:1.mcap": "'id:1.mcap' means something else as a SOURCE",
    f"{RECORD} -o 'a\n.mcap'": "contains a control character",
    f"record {S2} --beams 90": "--beams belongs to --scans",
    "export run.mcap run.npz --order measured": "--order belongs to an OUT that ends with .mcap",
    "export a.mcap a.txt": "does not end in .npz, .csv, .mcap",
    "export a.mcap b.mcap c.npz": "OUT needs {}",
    "export a.mcap x/a.mcap {}.npz": "two of the files have the same name",
    "play run.mcap --rate nan": "'nan' is not a finite number",
    **{f"stats {S2} -t '{text}'": f"'{text}' is not a duration" for text in ("0s", "-1s", "10 parsecs", "", "nan")},
    f"stats {S2} -t 1e9s": "'1e9s' is not a duration",
    f"plot {S2} -o x.jpg": "does not end in .svg, .png",
    f"report {S2} -o x.txt": "does not end in .mcap",
    "report --check": "--check reads the report that SOURCE names",
    "report --check a.mcap --force": "--force belongs to a report that is made",
    "report --check a.mcap -o b.mcap": "--output belongs to a report that is made",
    f"publish --ros {S2} --cloud points": "--cloud belongs to several lidars",
    f"publish {S2}": "say one of --ros and --zenoh KEY",
    f"publish {S2} --ros --zenoh a": "say one of --ros and --zenoh KEY",
    f"publish {S2} --ros --raw": "--raw belongs to --zenoh KEY",
    f"publish {S2} --zenoh a --frame x": "--frame belongs to --ros",
    f"publish {S2} --zenoh a --mount-yaw 3": "--mount-yaw belongs to --ros",
    f"publish {S2} --zenoh a --mount 0,0,0": "--mount belongs to --ros",
    f"publish {S2} --ros --stamps now": "--stamps is for a recording",
    f"publish {S2} --ros --mount 0,0": "is not x,y,yaw in metres and degrees",
    f"publish {S2} --ros --idle-stop never": "is not a duration",
    f"publish {S2} run.mcap --ros": "a recording is of another time",
    f"publish {S2} {S2} --zenoh a": "several lidars become one with --ros",
    f"publish {S2} {S2} --ros --mount 0,0,0": "2 lidars and 1 mount: once",
    f"publish {S2} {S2} --ros --mount-yaw 3": "--mount-yaw is for one lidar",
    f"publish {S2} {S2} --ros --frame x": "--frame is for one lidar",
    f"publish {S2} --ros --router tpc/localhost:7447": "host",
    f"publish {S2} --ros --router tcp/localhost": "host",
    "devices --zenoh /dev/ttyUSB0": "--zenoh asks no ports",
    "router --listen nonsense": "is not the address of a router",
    "view sim://nosuchmodel": "no simulated lidar 'nosuchmodel'",
    f"view {S2} --port 0 --mode nosuchmode": "no scan mode 'nosuchmode'",
    # /proc says that it may be written. It was told when the page was to record.
    **{
        f"view /dev/nosuchport --port 0 --record '{folder}'": f"'--record': no file can be made in '{folder}'"
        for folder in ("/dev/full", "/proc", "/no/such/folder", "")
    },
    f"view {S2} --port 70000": "70000 is not in the range",
    f"view {S2} --mount 1,2": "'1,2' is not x,y,yaw",
    f"view {S2} --mount 1,2,nan": "'1,2,nan' is not x,y,yaw",
    f"view {S2} --mount 0,0,0 --mount 0,0,0": "more mounts or colours than sources",
    f"view {S2} --colour red": "'red' is not a colour such as",
    f"view {' '.join([S2] * 17)}": "a page shows 16 lidars at most",
    "calibrate a b --picture x.png": "does not end in .svg",
}
"""What is typed, and what is said."""


@pytest.mark.parametrize(("typed", "said"), REFUSED.items(), ids=[words.split(S2)[0] for words in REFUSED])
def test_what_cannot_be_is_refused(typed: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    ended = invoke_driven(*shlex.split(typed))
    assert (ended.exit_code, ended.stdout) == (2, "")
    first, *more = ended.stderr.splitlines()
    assert first.startswith("error: ")
    assert said in first
    assert all(line.startswith(" " * 7) for line in more)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "mode"), [("1", 1), ("DenseBoost", "DenseBoost"), ("²", "²"), ("9" * 5000, "9" * 5000), ("-1", "-1")]
)
def test_a_scan_mode_is_named_alike_in_every_verb(text: str, mode: str | int) -> None:
    for command in (plot, publish, record, scan, stats, view, watch):
        (option,) = (each for each in command.params if each.name == "mode")
        assert option.type.convert(text, None, None) == mode


@pytest.mark.parametrize(
    ("text", "seconds"), [("10s", 10), ("500 ms", 0.5), (".5", 0.5), ("2m", 120), ("2min", 120), ("1h", 3600)]
)
def test_durations_are_written_alike_for_every_verb(text: str, seconds: float) -> None:
    for command in (stats, record):
        (option,) = (each for each in command.params if each.name == "seconds")
        assert option.type.convert(text, None, None) == seconds
