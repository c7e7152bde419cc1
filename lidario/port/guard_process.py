"""The guard: a process of its own, which leaves one device still when the program that drives it is dead.

`lidario.port.guard` starts this file by its path and tells the process, over a socket, which descriptor leads to
the device and what stops it. While the program lives, the guard waits for the next message: it never reads or
writes the line. When the socket ends without a farewell, nobody else can stop the device any more. Then the guard
writes the stop requests, closes the line and ends.

It imports nothing of lidario, and almost only what is compiled: so it starts in 20 ms and needs 7 MB, half of them
shared with other interpreters. `socket` alone would be 1.8 MB more than `_socket`.
"""

import _socket
import fcntl
import os
import sys
import termios
import time

FAREWELL = b"farewell"
HURRIED = b"hurried"
LOW_LATENCY = 0x2000
"""Of the flags in ``struct serial_struct``; lidario.port.adapter says what it is for."""
_FLAGS = slice(16, 20)
"""Their place in it: the fifth of its numbers."""
LEAST = 5
"""How often the stop requests are written at least. A device does not hear what comes within 10 ms of a STOP, be it
the program's last one or ours, nor while it responds, which takes a few milliseconds. And bytes may be damaged."""
GROWTH = 1.5
"""Each pause is that much longer than the one before. From 15 ms on, the five attempts come at 0, 15, 37, 71 and
122 ms: two early ones that stop almost every device, and the last one within 0.2 s, so far behind the one before
that a slow adapter or a busy machine cannot make them one."""
LONGEST_S = 2.5
"""Longest time for which a response that the device still owes is waited for: the longest one takes 2 s."""
DRAIN_S = 0.1
"""Longest time that the last bytes may need to leave. Of an adapter that is stuck they are discarded then, since
closing it would wait for up to 30 s."""
DELIVERY_S = 1.0
"""The same for a connection, whose network may be down for a moment. If it is closed earlier, the system drops
these bytes as soon as the device sends something."""
POLL_S = 0.005

Requests = list[tuple[bytes, bool | None]]
"""For each request its bytes and the state of DTR."""
Order = tuple[Requests, Requests, float, float]
"""What stops the device; what is written once at the end; the pause in seconds that the device needs after each
time; and when it listens at the latest, on the monotonic clock."""

STATES: dict[str, bool | None] = {"-": None, "0": False, "1": True}


def main() -> None:
    """Be the guard: ``guard_process.py NAME PID PORT``, with the socket as standard input."""
    # What the program has made inheritable is not ours, such as the socket on which it listens.
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))
    if os.fork():
        # So the guard is no child of the program, which may wait for all of its own.
        os._exit(0)
    # All signals are blocked from the start on. This is for those who send SIGKILL to a whole group or session.
    os.setsid()
    try:
        with open("/proc/self/comm", "w", encoding="ascii") as name:
            name.write(sys.argv[1])
    except OSError:
        pass  # only Linux has it
    channel = _socket.socket(fileno=0)
    channel.send(b"%d\n" % os.getpid())
    order, handle, hurried = last_order(channel)
    if handle >= 0:
        if order is not None:
            leave_still(handle, order)
            if hurried:
                clear_low_latency(handle)
        # Before the socket, whose end tells the program that the line is free.
        os.close(handle)
    os._exit(0)


def last_order(channel: _socket.socket) -> tuple[Order | None, int, bool]:
    """Wait for the end of the socket.

    Returns what was said last, None after a farewell; the descriptor of the line; and whether low latency was set.
    """
    held, last, handle, hurried = b"", b"", -1, False
    while True:
        try:
            data, passed, _, _ = channel.recvmsg(4096, _socket.CMSG_SPACE(4))
        except ConnectionResetError:  # it has not even read our pid
            data, passed = b"", []
        if not data:
            return order_in(last), handle, hurried
        for _, _, numbers in passed:
            handle = int.from_bytes(numbers[:4], sys.byteorder)
        *told, held = (held + data).split(b"\n")
        for line in told:
            if line == HURRIED:
                hurried = True
            else:
                last = line
        if last == FAREWELL:
            return None, handle, hurried


def order_in(line: bytes) -> Order | None:
    """The order in a message: two times, how many requests are for the end, and then all requests.

    Of each request the state of DTR, and its bytes in hexadecimal.
    """
    if not line:
        return None  # nothing was said yet
    settle, listens_at, count, *words = line.decode().split()
    requests = [(bytes.fromhex(word[1:]), STATES[word[0]]) for word in words]
    return requests[int(count) :], requests[: int(count)], float(settle), float(listens_at)


def leave_still(handle: int, order: Order) -> None:
    """Write the stop requests, `LEAST` times and until the device must have listened, and let them leave."""
    requests, last, settle, listens_at = order
    if not any(data or dtr is not None for data, dtr in requests):
        return  # a device that only talks
    listens_at = min(listens_at, time.monotonic() + LONGEST_S)
    pause, attempts = settle, 0
    while True:
        left = listens_at - time.monotonic()
        for data, dtr in requests:
            write(handle, data, dtr)
        attempts += 1
        if attempts >= LEAST and left <= 0:
            break
        # The last one comes as soon as the device listens.
        time.sleep(pause if left <= 0 else min(pause, max(settle, left)))
        pause *= GROWTH
    if last:
        time.sleep(settle)
        for data, dtr in last:
            write(handle, data, dtr)
    drain(handle)


def write(handle: int, data: bytes, dtr: bool | None) -> None:
    """Write one request, now or never: a line that takes nothing, or is dead, cannot be helped.

    One by one, since a device that gets datagrams may look for one request in each.
    """
    try:
        if dtr is not None:
            set_dtr(handle, dtr)
    except (OSError, termios.error):
        pass
    try:
        if data:
            os.write(handle, data)
    except OSError:
        pass


def set_dtr(handle: int, asserted: bool) -> None:
    """Put the control line in a state that lasts when the port is closed."""
    if asserted:
        # By itself the system clears it then, and a motor that runs while DTR is cleared would start.
        settings = termios.tcgetattr(handle)
        settings[2] &= ~termios.HUPCL
        termios.tcsetattr(handle, termios.TCSANOW, settings)
    change = termios.TIOCMBIS if asserted else termios.TIOCMBIC
    fcntl.ioctl(handle, change, termios.TIOCM_DTR.to_bytes(4, sys.byteorder))


def clear_low_latency(handle: int) -> None:
    """Have an FTDI adapter gather bytes again, as it did before the program was started."""
    settings = bytearray(128)
    try:
        fcntl.ioctl(handle, termios.TIOCGSERIAL, settings)
        flags = int.from_bytes(settings[_FLAGS], sys.byteorder) & ~LOW_LATENCY
        settings[_FLAGS] = flags.to_bytes(4, sys.byteorder)
        fcntl.ioctl(handle, termios.TIOCSSERIAL, settings)
    except (OSError, termios.error):
        pass  # it is dead


def drain(handle: int) -> None:
    """Wait until what was written has left, for a bounded time."""
    deadline = time.monotonic() + (DRAIN_S if os.isatty(handle) else DELIVERY_S)
    try:
        while any(fcntl.ioctl(handle, termios.TIOCOUTQ, bytes(4))):
            if time.monotonic() > deadline:
                termios.tcflush(handle, termios.TCOFLUSH)
                return
            time.sleep(POLL_S)
    except (OSError, termios.error):
        pass  # it is dead, or a socket that cannot tell


if __name__ == "__main__":
    main()
