"""The command on a machine whose adapters umockdev makes up: the folders of ``/sys`` as Linux has them, links too.

umockdev puts itself between the command and the system, so that all read ``/sys`` and ``/dev`` where they are on a
user's machine, pyserial's list of ports too. It has no control lines and no drivers: `tests.support.drivers` is for
those. A port that is opened is no terminal here.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ADAPTER = """\
P: {at}/{place}:1.0/ttyUSB{number}/tty/ttyUSB{number}
N: ttyUSB{number}
E: DEVNAME=/dev/ttyUSB{number}
E: MAJOR=188
E: MINOR={number}
E: SUBSYSTEM=tty
A: dev=188:{number}\\n
L: device=../../../ttyUSB{number}

P: {at}/{place}:1.0/ttyUSB{number}
E: DRIVER={driver}
E: SUBSYSTEM=usb-serial
A: {port}\\n

P: {at}/{place}:1.0
E: DEVTYPE=usb_interface
E: DRIVER={driver}
E: SUBSYSTEM=usb
A: bInterfaceNumber=00\\n

P: {at}
E: DEVTYPE=usb_device
E: DRIVER=usb
E: SUBSYSTEM=usb
E: PRODUCT={product}
A: idVendor={vendor}\\n
A: idProduct={kind}\\n
A: serial={serial}\\n
A: product={name}\\n
A: bNumInterfaces= 1\\n
A: power/control={power}\\n
"""
USB = "/devices/pci0000:00/0000:00:14.0/usb1"
FTDI = ADAPTER.format(
    at=f"{USB}/1-2", place="1-2", number=0, driver="ftdi_sio", port="latency_timer=16", product="403/6001/600",
    vendor="0403", kind="6001", serial="AH06W0EQ", name="FT232R USB UART", power="auto",
)  # fmt: skip
CP2102 = ADAPTER.format(
    at=f"{USB}/1-4/1-4.1", place="1-4.1", number=1, driver="cp210x", port="port_number=0", product="10c4/ea60/100",
    vendor="10c4", kind="ea60", serial="0001", name="CP2102 USB to UART Bridge Controller", power="on",
)  # fmt: skip
PATIENCE_S = 120


def told(folder: Path, devices: str, *arguments: str) -> str:
    """What the command prints on a machine with these devices."""
    described = folder / "devices.umockdev"
    described.write_text(devices, encoding="utf-8")
    command = ["umockdev-run", "--device", str(described), "--", sys.executable, "-m", "lidario", *arguments]
    for _ in range(5):
        ended = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=PATIENCE_S, check=False)
        # umockdev 0.17 aborts a program that looks at a link which vanishes meanwhile, as those do that tell which
        # files other processes have open.
        if "libumockdev-preload.c" not in ended.stderr:
            break
    assert "Traceback" not in ended.stderr
    assert ended.stdout, (ended.returncode, ended.stderr)
    return ended.stdout


@pytest.mark.long
@pytest.mark.parametrize(
    ("port", "match", "has_timer"),
    [("/dev/ttyUSB0", 'ATTR{}{{serial}}=="AH06W0EQ"', True), ("/dev/ttyUSB1", 'KERNEL{}=="1-4.1"', False)],
    ids=["by its number", "by its place"],
)
def test_the_rules_for_one_of_two(tmp_path: Path, port: str, match: str, has_timer: bool) -> None:
    rules = told(tmp_path, f"{FTDI}\n{CP2102}", "udev", port)
    assert rules.count(match.format("")) == 1
    # Of the adapter that is above the port, and above its timer.
    assert rules.count(match.format("S")) == 1 + has_timer
    assert rules.count("latency_timer") == has_timer
    assert ("AH06W0EQ" in rules) is has_timer


@pytest.mark.long
@pytest.mark.parametrize("verb", ["doctor", "devices"])
def test_what_is_plugged_in_is_found(tmp_path: Path, verb: str) -> None:
    found = json.loads(told(tmp_path, f"{FTDI}\n{CP2102}", verb, "--json"))
    if verb == "devices":
        assert [(each["port"], each["adapter"]) for each in found] == [
            ("/dev/ttyUSB0", "FT232"), ("/dev/ttyUSB1", "CP2102"),
        ]  # fmt: skip
        return
    by_port = {
        (each["port"], each["what"]): each["state"] for each in found if each["port"] and each["what"] != "port"
    }
    assert by_port == {
        ("/dev/ttyUSB0", "adapter"): "ok",
        ("/dev/ttyUSB0", "power"): "hint",
        ("/dev/ttyUSB0", "name"): "ok",
        ("/dev/ttyUSB1", "adapter"): "ok",
        ("/dev/ttyUSB1", "name"): "hint",
    }
