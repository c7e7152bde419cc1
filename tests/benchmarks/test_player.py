"""The player's line loses what a real one would."""

import fcntl
import os
import struct
import termios
import time

from benchmarks import player
from benchmarks.streams import RATES


def unread(handle: int) -> int:
    (count,) = struct.unpack("i", fcntl.ioctl(handle, termios.FIONREAD, bytes(4)))
    return int(count)


def test_a_line_that_holds_4_kib_loses_what_is_beyond() -> None:
    played = player.Played(RATES["S2 DenseBoost"], 0, 1, holds=4096)
    slave = os.open(played.path, os.O_RDWR | os.O_NOCTTY)
    try:
        written = 0
        for _ in range(100):
            played.write(bytes(64))
            written += 64
            deadline = time.monotonic() + 20
            # The kernel carries bytes from one end to the other in a thread of its own.
            while unread(slave) != min(written, 4095) and time.monotonic() < deadline:
                time.sleep(0.0005)
        assert unread(slave) == 4095
        assert played.lost == written - 4095
    finally:
        for handle in (slave, played.slave, played.master):
            os.close(handle)
