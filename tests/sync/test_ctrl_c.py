"""Ctrl-C is raised at every line that the program's thread executes while it waits for the session's own thread.

What both threads share must survive that. The locks of `threading.Condition` do not: Ctrl-C in the midst of
`Condition.wait` leaves the lock so that the other thread fails or waits for ever.
"""

import gc
import threading

import pytest

from lidario.sync.lidar import open_sync
from tests.support.devices import Rig, is_off, make_rig
from tests.support.interrupt import interrupted
from tests.sync.test_lidar import wait_for_threads

pytestmark = pytest.mark.usefixtures("quick_collection")


@pytest.mark.long
@pytest.mark.exhaustive("stride", sample=[23], full=[9])
@pytest.mark.parametrize("at", ["asking", "closing"])
def test_ctrl_c_at_every_line_of_a_wait(at: str, stride: int) -> None:
    line, places = stride // 2, 0
    while True:
        rig = make_rig("rplidar")
        threads = set(threading.enumerate())
        place = ask_and_close(rig, at, line)
        gc.collect()
        wait_for_threads(threads)
        assert is_off(rig.device), place
        if not place:
            break
        places += 1
        line += stride
    assert places * stride >= 12


def ask_and_close(rig: Rig, at: str, line: int) -> str:
    """Raise KeyboardInterrupt at the n-th line of asking or closing; where that was, or "" when it has fewer."""
    try:
        with open_sync(rig.device) as lidar:
            scans = lidar.scans()
            next(scans)
            if at == "asking":
                interrupted(line, lambda: lidar.stats)
            else:
                interrupted(line, lidar.close)
    except KeyboardInterrupt as error:
        return str(error)
    return ""
