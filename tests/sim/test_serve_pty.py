"""Serving a device over a real pseudo-terminal.

The device here is a stand-in; see `tests.support.parrot`.
"""

from __future__ import annotations

import os
import time
from itertools import pairwise

import pytest

from lidario.sim.faults import parse_faults
from lidario.sim.serve import PtyServer
from tests.support.children import until
from tests.support.parrot import BOUND, Parrot, opened, read_exactly
from tests.support.replug import ReplugPtyServer

pytestmark = pytest.mark.usefixtures("no_thread_is_left")


class TestPty:
    def test_streams_without_being_asked_again_at_true_pace(self) -> None:
        with PtyServer(Parrot(), chunk=64) as server, opened(server.path) as port:
            began = time.monotonic()
            os.write(port, b"#")
            data = read_exactly(port, 10_000)
            assert time.monotonic() - began >= 10_000 * 20e-6  # 50 kB/s and no faster
            assert data == (bytes(range(256)) * 40)[:10_000]
            assert server.lost == 0

    def test_what_the_terminal_cannot_take_is_lost(self) -> None:
        with PtyServer(Parrot()) as server, opened(server.path) as port:
            os.write(port, b"#")
            until(lambda: server.lost > 0)  # nobody reads

    @pytest.mark.long
    def test_what_is_held_back_comes_though_nothing_follows(self) -> None:
        faults = parse_faults("stall:990ms")
        with PtyServer(Parrot(), faults=faults) as server, opened(server.path) as port:
            sent = 0

            def held_back() -> bool:
                nonlocal sent
                sent += os.write(port, b"a")
                return faults.wakeup(0) is not None

            until(held_back)
            assert read_exactly(port, sent) == b"A" * sent

    def test_a_failing_device_is_reported_by_close(self) -> None:
        server = PtyServer(Parrot())
        with opened(server.path) as port:
            os.write(port, b"!")
            until(lambda: server.unplugged)
        with pytest.raises(RuntimeError, match="device failed") as caught:
            server.close()
        assert isinstance(caught.value.__cause__, ZeroDivisionError)
        server.close()

    def test_replug_as_often_as_one_likes_costs_no_descriptors(self) -> None:
        with ReplugPtyServer(Parrot()) as server:
            before = len(os.listdir("/proc/self/fd"))
            names = [server.path]
            for _ in range(5):
                server.replug(0.0)
                assert server.plugged.wait(BOUND)
                names.append(server.path)
            assert all(a != b for a, b in pairwise(names))
            # The name before the last one is held.
            assert len(os.listdir("/proc/self/fd")) == before + 1

    @pytest.mark.parametrize("gap_s", [None, 0.0], ids=["unplugged", "replugged"])
    def test_the_name_of_a_port_that_is_gone_is_given_to_nobody(self, gap_s: float | None) -> None:
        """Whoever tries to open it again would write to somebody else's terminal."""
        with ReplugPtyServer(Parrot()) as server:
            gone = server.path
            if gap_s is None:
                server.unplug()
            else:
                server.replug(gap_s)
                assert server.plugged.wait(BOUND)
            assert not os.path.exists(gone)
            pairs = [os.openpty() for _ in range(3)]
            names = {os.ttyname(slave) for _, slave in pairs}
            for handle in (each for pair in pairs for each in pair):
                os.close(handle)
            assert gone not in names

    @pytest.mark.long
    def test_a_fault_replugs_it(self) -> None:
        with PtyServer(Parrot(), faults=parse_faults("replug:50ms")) as server:
            first = server.path
            with opened(first) as port:
                os.write(port, b"#")
                until(lambda: not server.plugged.is_set())
            assert server.plugged.wait(BOUND)
            assert server.path != first
            with opened(server.path) as port:
                assert len(read_exactly(port, 100)) == 100

    @pytest.mark.long
    def test_a_replug_with_an_unplug_behind_it_ends(self) -> None:
        faults = parse_faults("replug:10ms,unplug:100ms")
        with PtyServer(Parrot(), faults=faults) as server, opened(server.path) as port:
            os.write(port, b"#")
            until(lambda: server.unplugged)

    def test_close_while_the_cable_is_out(self) -> None:
        server = ReplugPtyServer(Parrot())
        server.replug(600.0)
        server.close()
        assert server.unplugged
        assert not server.plugged.is_set()
