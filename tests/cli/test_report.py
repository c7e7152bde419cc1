"""``lidario report``: a page and a file, whatever becomes of the device meanwhile."""

import json
import os
from pathlib import Path

import pytest
from mcap.reader import make_reader

from lidario.cli.machine import Machine
from lidario.conformance import RULES, Outcome, Reporter, read_report
from lidario.port.port import Port
from lidario.sim.serve import PtyServer
from tests.cli.processes import end, invoke, invoke_driven, run, served, started
from tests.support.children import BOUND, requests, until, was_stopped
from tests.support.drivers import SPEED_FLAG, FakeDriver
from tests.support.recorded import thread_takes_no_time

PACKET_NS = 20_000_000
ONE_TRY = "?baud=115200&family=hlds"
"""All families at all speeds take ten seconds."""
LD19 = "sim://ldrobot-ld19?via=memory"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "report.mcap"


@pytest.mark.long
def test_a_report_is_a_page_and_a_file_that_is_checked(path: Path) -> None:
    result = invoke_driven("report", LD19, "-o", str(path), code=0)
    assert result.stderr.startswith("The report will hold every byte")
    assert "The serial number is hashed" in result.stderr
    assert f"wrote {path} (0." in result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["lidar", "LDROBOT", "LD06,", "LD19", "or", "alike"]
    told = {
        line.split("  ")[0] + "/" + line.split()[1 if line.startswith("held") else 2]
        for line in lines
        if "-" in line
    }
    assert {"held/sample-time", "not tried/reset-boots"} <= told, result.stdout
    report = read_report(path)
    counts = {outcome: len(report.with_outcome(outcome)) for outcome in Outcome}
    assert lines[-1].strip() == ", ".join(f"{count} {outcome.value}" for outcome, count in counts.items())
    assert sum(counts.values()) == len(RULES)
    result = invoke_driven("report", "--check", str(path), code=0)
    assert "new      nothing: all of it is known" in result.stdout
    assert "note: it is of a simulated device" in result.stderr
    page = json.loads(invoke_driven("report", "--check", str(path), "--json").stdout)
    assert page["info"]["model"] == "LDROBOT LD06, LD19 or alike"
    assert [each["rule"] for each in page["tried"]] == [rule.name for rule in RULES]
    assert page["facts"]["line"] == "simulated, 230400 baud"
    # Every other command reads it.
    assert invoke("info", str(path)).exit_code == 0


@pytest.mark.long
def test_a_sick_device(path: Path) -> None:
    result = invoke_driven("report", LD19 + "&fault=flip:0.2%", "-o", str(path), "--json", code=0)
    tried = {each["rule"]: each for each in json.loads(result.stdout)["tried"]}
    assert tried["packets-are-whole"]["outcome"] == "not held"
    # Samples that are missing do not make the others slower.
    assert tried["sample-time"]["outcome"] == "not tried"
    assert "skipped_bytes" in tried["packets-are-whole"]["text"]


@pytest.mark.long
def test_ctrl_c_leaves_what_was_tried(path: Path) -> None:
    with served("rplidar-s2") as server:
        with started("report", server.path, "-o", str(path)) as process:
            # The first rules only ask; all of them take half a minute.
            until(lambda: any("scan" in each.name for each in requests(server)))
            stdout, stderr = end(process)
        assert process.returncode == 130, stderr
        until(lambda: was_stopped(server))
    assert f"wrote {path}" in stderr
    assert server.path not in stdout
    report = read_report(path)
    assert not report.is_complete
    assert report.tried[0].outcome is Outcome.HELD
    assert report.facts["adapter"] == "none: a pseudo-terminal"
    assert "the report was ended before" in stdout
    assert "note: it was ended before" in run("report", "--check", str(path)).stderr


@pytest.mark.long
def test_a_program_that_is_killed_leaves_what_was_tried(path: Path) -> None:
    with served("rplidar-s2") as server:
        with started("report", server.path, "-o", str(path)) as process:
            # Each verdict is in the file within a second or two.
            until(lambda: path.exists() and b"rule" in path.read_bytes())
            until(lambda: read_report(path).with_outcome(Outcome.HELD))
            process.kill()
            process.communicate(timeout=BOUND)
        serial = bytes.fromhex(server.device.serial.hex())  # type: ignore[attr-defined]
    report = read_report(path)
    assert not report.is_complete
    assert report.tried[0].outcome is Outcome.HELD
    assert [each.rule for each in report.tried] == [rule.name for rule in RULES]
    assert serial not in path.read_bytes()


class Stranger:
    """A device that nobody knows: it talks in packets of its own, and hears nothing."""

    def __init__(self) -> None:
        self.count = self.at = 0

    def receive(self, data: bytes, now: int) -> None:
        """Nothing is heard."""

    def transmit(self, now: int) -> bytes:
        if now < self.at:
            return b""
        self.at, self.count = now + PACKET_NS, self.count + 1
        return b"\x7e\x42" + self.count.to_bytes(4, "big") + bytes(range(20)) + b"\x0d"

    def wakeup(self, now: int) -> int:
        return self.at


class Mute(Stranger):
    """One that says nothing."""

    def transmit(self, now: int) -> bytes:
        return b""


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each speed is listened to for a moment."""
    monkeypatch.setattr("lidario.conformance.unknown.LISTEN_S", 0.05)


@pytest.mark.long
@pytest.mark.usefixtures("quick")
def test_a_device_that_nobody_knows(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device, change = Stranger(), Port.set_baudrate

    def set_baudrate(port: Port, speed: int) -> None:
        change(port, speed)
        # On a busy machine it might say nothing in the moment for which it is listened to.
        begin = device.count
        until(lambda: device.count > begin + 2)

    monkeypatch.setattr(Port, "set_baudrate", set_baudrate)
    with PtyServer(device) as server:  # type: ignore[arg-type]
        result = invoke("report", f"serial://{server.path}{ONE_TRY}", "-o", str(path), code=5)
    assert "nothing responds" in result.stderr
    assert f"wrote {path}" in result.stderr
    report = read_report(path)
    assert (report.about.info.family, report.about.info.model, report.tried) == ("", "unknown", ())
    at = {name: text for name, text in report.facts.items() if name.startswith("at ")}
    # Speeds of other devices, too.
    assert {"at 115200 baud", "at 1000000 baud", "at 9600 baud"} <= set(at)
    assert " 7e 42 00 00 " in at["at 9600 baud"]
    assert server.path not in "".join(report.facts.values())
    with path.open("rb") as file:
        messages = [
            (channel.topic, bytes(message.data)) for _, channel, message in make_reader(file).iter_messages()
        ]
    speeds = [data for topic, data in messages if topic == "/lidar/events" and b'"speed"' in data]
    assert len(speeds) >= len(at)
    received = b"".join(data for topic, data in messages if topic == "/lidar/raw")
    assert received.count(bytes(range(20))) > 10
    checked = invoke("report", "--check", str(path), code=0)
    assert "model unknown" in checked.stdout
    assert "at 9600 baud" in checked.stdout
    told = invoke("info", str(path))
    assert (told.exit_code, "responds in no known way" in told.stderr) == (7, True)


@pytest.mark.long
@pytest.mark.usefixtures("quick")
def test_where_nothing_comes_at_all_no_file_is_made(path: Path) -> None:
    with PtyServer(Mute()) as server:  # type: ignore[arg-type]
        result = invoke("report", f"serial://{server.path}{ONE_TRY}", "-o", str(path), code=5)
    assert "nothing came back" in result.stderr
    assert not path.exists()


@pytest.mark.long
def test_the_port_is_told(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served("rplidar-s2") as server:
        root = tmp_path / "root"
        driver = FakeDriver(server.path, monkeypatch, root)
        device = root / "sys/class/tty" / Path(server.path).name / "device"
        for name, text in (("idVendor", "0403"), ("idProduct", "6001"), ("serial", "AH06W0EQ")):
            (device / name).write_text(text)
        monkeypatch.setattr("lidario.conformance.RULES", RULES[:1])
        monkeypatch.setattr("lidario.cli.report.Machine", lambda: Machine(root))
        node = root / server.path.lstrip("/")
        node.parent.mkdir(parents=True)
        node.touch()
        node.chmod(0o660)
        invoke("report", server.path, "-o", str(path), code=0)
    facts = read_report(path).facts
    assert facts["latency"] == "it gathers bytes for 1 ms while it is open, else for 16 ms"
    assert facts["access"].startswith("-rw-rw----")
    assert facts["access"].endswith("this user may open it")
    assert facts["adapter"] == "unknown (0403:6001)"
    assert "AH06W0EQ" not in "".join(facts.values())
    assert driver.flags == SPEED_FLAG


@pytest.mark.long
def test_a_device_that_is_lost_meanwhile(path: Path) -> None:
    with thread_takes_no_time():
        invoke_driven("report", "sim://rplidar-s2?via=memory&fault=unplug:3s", "-o", str(path), code=0)
    report = read_report(path)
    assert "the line to the device is lost" in {each.text for each in report.tried}
    assert report.tried[0].outcome is Outcome.HELD


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("/dev/ttyNONE9",), 3, "no such port: '/dev/ttyNONE9'"),
        (("run.mcap",), 2, "rules are tried on a device"),
        (("--check", "missing.mcap"), 7, "missing.mcap"),
        (("--check", __file__), 7, "is no report"),
    ],
)
def test_where_there_is_nothing_to_try_no_file_is_made(
    arguments: tuple[str, ...], code: int, said: str, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(path.parent)
    result = invoke("report", *arguments, code=code)
    assert said in result.stderr
    assert not list(path.parent.iterdir())


def test_a_file_that_is_taken_away_meanwhile_hides_nothing(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was an unexpected FileNotFoundError in place of the page."""

    async def taken_away(*_: object, **__: object) -> None:
        os.unlink(path)

    monkeypatch.setattr(Reporter, "run", taken_away)
    result = invoke_driven("report", LD19, "-o", str(path), code=4)
    assert f"{path} was removed while it was written" in result.stderr
    assert "wrote" not in result.stderr
    assert result.stdout.startswith("lidar")
