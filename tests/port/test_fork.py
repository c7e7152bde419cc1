"""A forked child ends, and its parent's lidar goes on; it lives on, and holds nothing that is its parent's."""

import signal
import socket
import threading
from contextlib import suppress

import pytest

from lidario.port.forked import leave_nothing
from lidario.sim.serve import TcpServer
from tests.support.children import BOUND, FORKS, child, ended, line_of
from tests.support.devices import make_rig, names
from tests.support.ports import open_files
from tests.support.speeds import SpeedPtyServer

INSIDE = """
import asyncio, os, sys, lidario

async def main():
    async with lidario.open_lidar(sys.argv[1]) as lidar:
        async with lidar.scans() as stream:
            await anext(stream)
            child = os.fork()
            if child == 0:
                leave(7)
            while os.waitpid(child, os.WNOHANG)[0] == 0:
                await asyncio.sleep(0.001)
            for _ in range(5):
                await anext(stream)
            print("interruptions", lidar.stats.interruptions, flush=True)
            sys.stdin.readline()

asyncio.run(main())
"""

BETWEEN = """
import asyncio, gc, os, sys, lidario

loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(lidario.open_lidar(sys.argv[1]).__aenter__())
stream = lidar.scans()
loop.run_until_complete(stream.__anext__())
child = os.fork()
if child == 0:
    del lidar, stream
    gc.collect()
    sys.exit(7)
os.waitpid(child, 0)
for _ in range(5):
    loop.run_until_complete(stream.__anext__())
print("interruptions", lidar.stats.interruptions, flush=True)
sys.stdin.readline()
loop.run_until_complete(lidar.close())
loop.close()
"""


@pytest.mark.long
@pytest.mark.parametrize("program", [INSIDE, BETWEEN], ids=["inside the running loop", "between two runs of it"])
def test_the_exit_of_a_forked_child_stops_nothing(program: str) -> None:
    rig = make_rig("rplidar")
    with SpeedPtyServer(rig.device) as server, child(FORKS + program, server.path) as process:
        # A parent whose lidar was stopped waits for ever.
        told = line_of(process.stdout)
        with server.lock:
            scanning, log = rig.device.scanning, names(rig)
        _, errors = process.communicate("\n", timeout=BOUND)
        assert told == "interruptions 0\n", errors
        assert scanning
        # Opening stops it, on a busy machine more than once; after that only the close does.
        assert "stop" not in log[log.index("express_scan") :]
        assert process.returncode == 0, errors
        with server.lock:
            assert not rig.device.scanning


def test_what_leads_to_nothing_takes_no_other_descriptor() -> None:
    """Its other end learns that it was closed, and its number stays taken."""
    here, there = socket.socketpair()
    with here, there:
        before = open_files()
        leave_nothing(here.fileno())
        assert open_files() == before
        assert there.recv(1) == b""


LEFT = (
    FORKS
    + """
import asyncio, os, signal, sys, time, lidario

def forked():
    reads, writes = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(writes, b"x")
        time.sleep(60)
        os._exit(0)
    os.read(reads, 1)  # it runs
    return child

async def main():
    async with lidario.open_lidar(sys.argv[1], family="rplidar") as lidar:
        await lidar.scan()
        child = forked()
"""
)
REOPENED = """
    async with lidario.open_lidar(sys.argv[1], family="rplidar") as lidar:
        print("open again", flush=True)
    os.kill(child, signal.SIGKILL)

lidario.run(main())
"""
CLOSED = """
    sys.stdin.readline()
    os.kill(child, signal.SIGKILL)

lidario.run(main())
"""
TERMINATED = """
        os.kill(child, signal.SIGTERM)
        print("child ended by", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
        await lidar.scan()
        print("the parent goes on", flush=True)

lidario.run(main())
"""


@pytest.mark.long
def test_a_port_is_free_when_it_is_closed_though_a_child_lives_on() -> None:
    with SpeedPtyServer(make_rig("rplidar").device) as server, child(LEFT + REOPENED, server.path) as process:
        assert process.communicate(timeout=BOUND) == ("open again\n", "")


@pytest.mark.long
def test_a_connection_ends_when_it_is_closed_though_a_child_lives_on() -> None:
    with socket.create_server(("127.0.0.1", 0)) as door, TcpServer(make_rig("rplidar").device) as server:
        door.settimeout(BOUND)
        with child(LEFT + CLOSED, f"tcp://127.0.0.1:{door.getsockname()[1]}") as process:
            host, _ = door.accept()
            with host, socket.create_connection(server.address) as device:
                pump = threading.Thread(target=relay, args=(device, host))
                pump.start()
                relay(host, device)  # until the program has closed it
                device.shutdown(socket.SHUT_RDWR)
                pump.join(BOUND)
            assert process.communicate("\n", timeout=BOUND) == ("", "")


@pytest.mark.long
def test_a_signal_to_a_child_ends_the_child_and_not_the_program() -> None:
    with SpeedPtyServer(make_rig("rplidar").device) as server, child(LEFT + TERMINATED, server.path) as process:
        said = f"child ended by {-signal.SIGTERM}\nthe parent goes on\n"
        assert process.communicate(timeout=BOUND) == (said, "")


SIGNALLED = """
import asyncio, os, signal, sys, time, lidario

def own(*_):
    os._exit(7)

def told(number):
    child = os.fork()
    if child == 0:
        try:
            os.kill(os.getpid(), number)
            time.sleep(60)
        except KeyboardInterrupt:
            os._exit(8)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)

async def main(change):
    told(signal.SIGINT)
    if change:
        signal.signal(signal.SIGTERM, own)
        told(signal.SIGTERM)
    await asyncio.sleep(0)
    raise ValueError

for change in (True, False):
    try:
        lidario.run(main(change))
    except ValueError as error:
        kept = error  # and with it all that `run` had
    signal.signal(signal.SIGTERM, own)
    told(signal.SIGTERM)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
"""


@pytest.mark.long
def test_signals_do_in_a_child_what_the_program_has_chosen() -> None:
    done = ended(FORKS + SIGNALLED)
    assert (done.stdout.split(), done.stderr) == (["8", "7", "7", "8", "7"], "")


def relay(begin: socket.socket, end: socket.socket) -> None:
    """Pass on what comes, until there is no more."""
    begin.settimeout(BOUND)
    with suppress(ConnectionError):
        while data := begin.recv(4096):
            end.sendall(data)
