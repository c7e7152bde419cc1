"""``lidario doctor`` and ``udev``, on machines that are folders."""

import json
from collections.abc import Iterable
from pathlib import Path

import pytest

import lidario
from lidario.cli.doctor import Finding, of_adapter, of_machine
from lidario.cli.machine import Machine
from lidario.cli.udev import general, is_unique, rule_for
from lidario.families.adapters import ADAPTERS
from tests.cli.processes import invoke, invoke_driven

PORT = lidario.PortInfo("/dev/ttyUSB9", "", "CP2102", "CP2102 bridge")


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """One with an adapter at ttyUSB9 whose serial number is that of thousands."""
    plug = tmp_path / "sys/devices/usb1/1-1.4"
    tty = plug / "1-1.4:1.0/ttyUSB9"
    tty.mkdir(parents=True)
    for name, text in (("idVendor", "10c4"), ("idProduct", "ea60"), ("serial", "0001")):
        (plug / name).write_text(text + "\n")
    known = tmp_path / "sys/class/tty/ttyUSB9"
    known.mkdir(parents=True)
    (known / "device").symlink_to(tty)
    return Machine(tmp_path)


def write(machine: Machine, path: str, text: str) -> None:
    file = machine.root / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def own_rules(machine: Machine) -> str:
    """The rules for the adapter of that machine alone."""
    usb = machine.usb(PORT.path)
    assert usb is not None
    return rule_for(usb, "front")


def of(findings: Iterable[Finding], what: str) -> Finding:
    (found,) = [each for each in findings if each.what == what]
    return found


def test_a_machine_with_nothing_wrong(machine: Machine) -> None:
    assert {each.state for each in of_machine(machine, [PORT.path])} == {"ok"}


def test_brltty_is_bad_where_it_takes_this_adapter(machine: Machine) -> None:
    write(machine, "usr/lib/udev/rules.d/85-brltty.rules", 'ENV{PRODUCT}=="1a86/7523/*", ENV{BRLTTY}="x"\n')
    assert of(of_machine(machine, [PORT.path]), "brltty").state == "ok"
    # Without a port it may be brltty that has taken it.
    assert of(of_machine(machine, []), "brltty").state == "bad"
    write(machine, "usr/lib/udev/rules.d/90-brltty-usb.rules", '#E=="10c4/ea60/*"\nE=="10C4/EA60/*", ENV{B}="x"\n')
    found = of(of_machine(machine, [PORT.path]), "brltty")
    assert found.state == "bad"
    assert "apt remove brltty" in found.cure
    assert "lidario udev" in found.cure


def test_a_rule_of_brltty_that_is_hidden_or_commented_out_takes_nothing(machine: Machine) -> None:
    write(machine, "usr/lib/udev/rules.d/85-brltty.rules", 'ENV{PRODUCT}=="10c4/ea60/*"\n')
    assert of(of_machine(machine, [PORT.path]), "brltty").state == "bad"
    write(machine, "etc/udev/rules.d/85-brltty.rules", '# ENV{PRODUCT}=="10c4/ea60/*"\n')
    assert of(of_machine(machine, [PORT.path]), "brltty").state == "ok"


@pytest.mark.parametrize("rules", ["general", "one"])
def test_our_rules_keep_brltty_off(machine: Machine, rules: str) -> None:
    write(machine, "usr/lib/udev/rules.d/85-brltty.rules", 'ENV{PRODUCT}=="10c4/ea60/*", ENV{BRLTTY}="x"\n')
    ours = general() if rules == "general" else own_rules(machine)
    write(machine, "etc/udev/rules.d/99-lidar.rules", "# " + ours.replace("\n", "\n# "))
    assert of(of_machine(machine, [PORT.path]), "brltty").state == "bad"
    write(machine, "etc/udev/rules.d/99-lidar.rules", ours)
    assert of(of_machine(machine, [PORT.path]), "brltty").state == "ok"
    # One adapter's rules are not another one's.
    write(machine, "usr/lib/udev/rules.d/85-brltty.rules", 'ENV{PRODUCT}=="403/6001/*", ENV{BRLTTY}="x"\n')
    assert of(of_machine(machine, []), "brltty").state == ("ok" if rules == "general" else "bad")


def test_modem_manager_is_a_hint_until_udev_says_that_it_leaves_the_port_alone(machine: Machine) -> None:
    write(machine, "proc/77/comm", "ModemManager\n")
    assert of(of_machine(machine, [PORT.path]), "ModemManager").state == "hint"
    write(machine, "sys/class/tty/ttyUSB9/dev", "188:9\n")
    write(machine, "run/udev/data/c188:9", "I:1\nE:ID_MM_CANDIDATE=1\n")
    assert of(of_machine(machine, [PORT.path]), "ModemManager").state == "hint"
    write(machine, "run/udev/data/c188:9", "I:1\nE:ID_MM_CANDIDATE=1\nE:ID_MM_PORT_IGNORE=1\n")
    assert of(of_machine(machine, [PORT.path]), "ModemManager").state == "ok"
    # A second adapter that is not told.
    assert of(of_machine(machine, [PORT.path, "/dev/ttyUSB8"]), "ModemManager").state == "hint"
    assert of(of_machine(machine, []), "ModemManager").state == "hint"


def test_a_machine_whose_supply_falls(machine: Machine) -> None:
    write(machine, "sys/class/hwmon/hwmon3/name", "rpi_volt\n")
    write(machine, "sys/class/hwmon/hwmon3/in0_lcrit_alarm", "0\n")
    assert all(each.what != "power" for each in of_machine(machine, []))
    write(machine, "sys/class/hwmon/hwmon3/in0_lcrit_alarm", "1\n")
    assert of(of_machine(machine, []), "power").state == "bad"


def test_an_adapter_is_told_with_its_speed_and_its_name(machine: Machine) -> None:
    found = list(of_adapter(machine, PORT))
    assert "1000000 baud" in of(found, "adapter").text
    assert of(found, "name").state == "hint"
    assert "lidario udev /dev/ttyUSB9" in of(found, "name").cure
    (machine.root / "sys/devices/usb1/1-1.4/serial").write_text("B12D9E\n")
    assert of(of_adapter(machine, PORT), "name").state == "ok"


def test_an_adapter_that_may_sleep(machine: Machine) -> None:
    assert all(each.what != "power" for each in of_adapter(machine, PORT))
    write(machine, "sys/devices/usb1/1-1.4/power/control", "auto\n")
    found = of(of_adapter(machine, PORT), "power")
    assert (found.state, "lidario udev" in found.cure) == ("hint", True)
    write(machine, "sys/devices/usb1/1-1.4/power/control", "on\n")
    assert all(each.what != "power" for each in of_adapter(machine, PORT))


def test_a_port_of_another_kind(machine: Machine) -> None:
    (found,) = of_adapter(machine, lidario.PortInfo("/dev/ttyS0", "", "", "built in"))
    assert (found.state, found.text) == ("hint", "built in: lidars are not sold with it")


@pytest.mark.parametrize(
    ("serial", "place", "timer"),
    [("0001", 'KERNEL{}=="1-1.4"', False), ("B12D9E", 'ATTR{}{{serial}}=="B12D9E"', True)],
)
def test_rules_by_serial_number_or_by_place_keep_the_adapter_awake_fast_and_alone(
    machine: Machine, serial: str, place: str, timer: bool
) -> None:
    write(machine, "sys/devices/usb1/1-1.4/serial", serial + "\n")
    if timer:
        write(machine, "sys/class/tty/ttyUSB9/device/latency_timer", "16\n")
    it, above = (
        f'ATTR{s}{{idVendor}}=="10c4", ATTR{s}{{idProduct}}=="ea60", {place.format(s)}, ' for s in ("", "S")
    )
    quiet = 'ATTR{power/control}="on", ENV{ID_MM_DEVICE_IGNORE}="1", ENV{SYSTEMD_WANTS}=""'
    access = 'SYMLINK+="front", GROUP="dialout", MODE="0660", ENV{ID_MM_PORT_IGNORE}="1"'
    assert own_rules(machine).splitlines()[1:] == [
        f'SUBSYSTEM=="usb", {it}{quiet}',
        *[f'SUBSYSTEM=="usb-serial", {above}ATTR{{latency_timer}}="1"'] * timer,
        f'SUBSYSTEM=="tty", {above}{access}',
    ]


@pytest.mark.parametrize(
    ("serial", "unique"),
    [("B12D9E", True), ("0001", False), ("", False), ('x", RUN+="/bin/sh', False), ("a\nb", False)],
)
def test_what_an_adapter_says_never_becomes_more_than_a_number(serial: str, unique: bool) -> None:
    assert is_unique(serial) is unique


def test_the_rule_of_the_command(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.cli.udev.Machine", lambda: machine)
    monkeypatch.setattr("lidario.list_serial_ports", lambda: [PORT])
    ended = invoke("udev", "--name", "front", code=0)
    assert ended.stdout.count('SYMLINK+="front"') == 1
    assert "99-lidar.rules" in ended.stderr
    told = json.loads(invoke("udev", PORT.path, "--json").stdout)
    assert (told["name"], told["port"]) == ("/dev/lidar", PORT.path)
    assert invoke("udev", "/dev/ttyUSB8").exit_code == 3


def test_the_rule_without_an_adapter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.list_serial_ports", list)
    ended = invoke("udev", code=0)
    assert ended.stdout.count('SUBSYSTEM=="tty"') == len(ADAPTERS)
    assert ended.stdout.count('SUBSYSTEM=="usb"') == len(ADAPTERS)
    # The timer is FTDI's alone.
    assert ended.stdout.count("latency_timer") == 2
    assert all("0403" in line for line in ended.stdout.splitlines() if "latency_timer" in line)
    assert "SYMLINK" not in ended.stdout


@pytest.fixture
def _own_machine(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.cli.doctor.Machine", lambda: machine)


@pytest.mark.usefixtures("_own_machine")
def test_a_lidar_with_nothing_wrong() -> None:
    ended = invoke_driven("doctor", "sim://rplidar-s2?via=memory", "--json", code=0)
    told = json.loads(ended.stdout)
    assert {each["state"] for each in told} == {"ok"}
    assert {"response", "health", "scans"} <= {each["what"] for each in told}
    assert "1000000 baud" in next(each["text"] for each in told if each["what"] == "response")


@pytest.mark.usefixtures("_own_machine")
@pytest.mark.parametrize(
    ("fault", "code", "what"), [("drop:0.1%", 0, "scans"), ("garbage", 5, "response"), ("silent:0s", 5, "response")]
)
def test_trouble_is_named_with_a_cure(fault: str, code: int, what: str) -> None:
    ended = invoke_driven("doctor", f"sim://rplidar-s2?via=memory&fault={fault}", "--json", code=code)
    (bad,) = [each for each in json.loads(ended.stdout) if each["state"] == "bad"]
    assert bad["what"] == what
    assert bad["cure"]


@pytest.mark.usefixtures("_own_machine")
@pytest.mark.parametrize(
    ("reason", "code", "what"),
    [("permission", 4, "access"), ("busy", 4, "access"), ("missing", 3, "port"), ("silent", 5, "response")],
)
def test_a_port_that_cannot_be_opened(
    monkeypatch: pytest.MonkeyPatch, reason: lidario.ConnectReason, code: int, what: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise lidario.ConnectFailed("no\nsudo do this", reason=reason)

    monkeypatch.setattr("lidario.open_lidar", fail)
    monkeypatch.setattr("lidario.list_serial_ports", lambda: [PORT])
    ended = invoke("doctor", "--json", code=code)
    bad = json.loads(ended.stdout)[-1]
    assert (bad["what"], bad["text"], bad["cure"], bad["port"]) == (what, "no", "sudo do this", PORT.path)
    people = invoke("doctor", code=code)
    assert "→ sudo do this" in people.stdout


@pytest.mark.usefixtures("_own_machine")
def test_nothing_is_plugged_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.list_serial_ports", lambda: [lidario.PortInfo("/dev/ttyS0", "", "", "built in")])
    ended = invoke("doctor", "--json", code=3)
    bad = json.loads(ended.stdout)[-1]
    assert (bad["state"], bad["what"]) == ("bad", "port")
    assert "/dev/ttyS0" in bad["cure"]


@pytest.mark.usefixtures("_own_machine")
def test_a_source_that_is_none() -> None:
    invoke("doctor", "sim://nosuchmodel", "--json", code=2)
