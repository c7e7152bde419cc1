"""A simulated lidar for a test: what it sees and what goes wrong are chosen when it is made, and may change later.

It is an ordinary simulated device in memory, as strict as `lidario.simulate` makes them. The rotor needs no time to
spin up, and while the loop of the test waits, time passes a hundred times as fast (`lidario.testing.clock`).
"""

import asyncio
import threading
import weakref
from collections.abc import Callable, Iterable

from lidario import InvalidValue, Received, SimulatedDevice, Wall, WorldLike, simulate
from lidario.basics.arguments import number, shown, text_of
from lidario.sim.faults import parse_faults
from lidario.sim.memory import MemoryLine
from lidario.testing.clock import FAST, clock_of
from lidario.testing.surroundings import Body, Surroundings, room


class SimulatedLidar:
    """A lidar in memory, to be given to `lidario.open_lidar`, `open_sync`, or a program that calls them.

    ::

        lidar = SimulatedLidar(walls=room(6, 4), bodies=[Body([(0, 1.0, 0.0)])], fault="drop:1%")
        async with lidario.open_lidar(lidar) as session:
            scan = await session.scan()

    The clock is fast in the loop of the main thread, where async tests run. A loop in another thread keeps real
    time: that of `open_sync`, or of a web framework's test client. So it does not run ahead of the test.

    Args:
        model: As `lidario.simulate`; ``lidario sim --list`` names all. None: the first of them.
        walls: What stands still: each ``((x1, y1), (x2, y2))`` in metres, x forward and y to the left, the lidar at
            the origin. None: a room of 4 m by 4 m. An empty list: nothing at all.
        bodies: What moves.
        world: Instead of walls and bodies, a name or an object, as for `lidario.simulate`.
        fault: What goes wrong, as in ``sim://MODEL?fault=``: ``"drop:1%"``, ``"silent:2s,flip:0.1%"``.
        noise: Standard deviation of the ranges, metres.
        spin_up: Seconds until the rotor turns at its speed.
        seed: Decides everything random.
        serial: Its serial number; None: drawn from the seed.
        pace: How many times as fast as in reality the clock of the loop goes, in any thread; 1 for real time. None:
            as described above.

    Raises:
        InvalidValue: An argument cannot be right; the text says why.
    """

    def __init__(
        self,
        model: str | None = None,
        *,
        walls: Iterable[Wall] | None = None,
        bodies: Iterable[Body] = (),
        world: str | WorldLike | None = None,
        fault: str = "",
        noise: float = 0.0,
        spin_up: float = 0.0,
        seed: int = 0,
        serial: str | bytes | None = None,
        pace: float | None = None,
    ) -> None:
        if world is not None and (walls is not None or bodies != ()):
            raise InvalidValue("give either a world, or walls and bodies")
        if pace is not None and not 1.0 <= number(pace, "pace") <= 1e6:
            raise InvalidValue(
                f"pace is a number from 1 on, how many times as fast the clock goes, not {shown(pace)}"
            )
        self._surroundings: Surroundings | None = None
        if world is None:
            world = self._surroundings = Surroundings(room() if walls is None else walls, bodies, noise, seed)
        self._device: SimulatedDevice = simulate(model, world=world, spin_up=spin_up, seed=seed, serial=serial)
        self._pace = pace
        self._seed = seed
        self._clocks: set[asyncio.AbstractEventLoop] = set()
        self._now = 0
        # Not held: the line of a session that is garbage goes with it.
        self._look: Callable[[], Callable[[], None] | None] = lambda: None
        self.fail(fault)

    def __repr__(self) -> str:
        state = "still" if self.is_still else "scanning" if self.scanning else "motor on"
        return f"<SimulatedLidar, {state}, {len(self.log)} requests>"

    # --------------------------------------------------------------------------------------- what a test calls

    def show(self, *, walls: Iterable[Wall] | None = None, bodies: Iterable[Body] | None = None) -> None:
        """Change what it sees, from now on; what is not given stays.

        The samples of the next few milliseconds may be measured already.

        Args:
            walls: As for the class.
            bodies: Likewise; the seconds of their paths count from now, or from the first opening.

        Raises:
            InvalidValue: It was made with a world of another kind, or the walls cannot be right.
        """
        if self._surroundings is None:
            raise InvalidValue("show() replaces walls and bodies, and this lidar was made with another world")
        self._surroundings.show(walls, bodies)
        if self._now:
            self._surroundings.begin(self._now)

    def fail(self, fault: str = "") -> None:
        """Have something go wrong from now on, instead of what went wrong before.

        ::

            simulated_lidar.fail("unplug:0s")  # the line is dead
            simulated_lidar.fail("silent:0s")  # it is open, and nothing comes
            simulated_lidar.fail()             # all is well again

        Args:
            fault: As in ``sim://MODEL?fault=``; ``lidario sim --list-faults`` lists all. Durations count from now,
                or from the first byte on the line.

        Raises:
            InvalidValue: There is no such fault.
        """
        text_of(fault, "a fault")
        try:
            self._faults = parse_faults(fault, seed=self._seed)
        except ValueError as error:
            raise InvalidValue(str(error)) from None
        self._line = MemoryLine(self._device, self._faults)
        # Its time begins at once where the line is in use; and at rest nobody else would look at the line.
        self._begins_at_once = bool(self._now)
        if (look := self._look()) is not None:
            look()

    @property
    def is_still(self) -> bool:
        """Whether laser and motor are off."""
        return not self.scanning and not self.motor_on

    @property
    def requests(self) -> list[str]:
        """Names of the requests that it obeyed, oldest first, as in ``["stop", "get_info"]``."""
        return [each.name for each in self.log if each.obeyed]

    def close(self) -> None:
        """Let every clock go at its usual pace again; the fixtures call it."""
        for loop in self._clocks:
            clock = clock_of(loop)
            if clock is not None:
                clock.set(1.0)
        self._clocks.clear()

    # ---------------------------------------------------------------------------- what every simulated device has

    @property
    def baudrate(self) -> int:
        """Speed of its line in bits a second."""
        return self._device.baudrate

    @property
    def log(self) -> list[Received]:
        """Every request so far, oldest first, the discarded ones included."""
        return self._device.log

    @property
    def scanning(self) -> bool:
        """Whether the laser measures, or will when the rotor is up to speed."""
        return self._device.scanning

    @property
    def motor_on(self) -> bool:
        """Whether the motor is powered."""
        return self._device.motor_on

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes that the host has sent; `now` in nanoseconds."""
        self._line.write(data, self._begin(now))

    def transmit(self, now: int) -> bytes:
        """The bytes that are due by `now`, in nanoseconds."""
        return self._line.read(self._begin(now))

    def wakeup(self, now: int) -> int | None:
        """When something is due next, in nanoseconds; None for never, as far as is known."""
        return self._line.wakeup(self._begin(now))

    def set_dtr(self, asserted: bool, now: int) -> None:
        """The host sets the control line DTR, by which some models switch their motor."""
        self._line.set_dtr(asserted, self._begin(now))

    def set_host_baudrate(self, baudrate: int, now: int) -> None:
        """The host sets the speed of its port; few devices notice."""
        self._line.set_baudrate(baudrate, self._begin(now))

    def unplugged(self, now: int) -> bool:
        """Whether its cable is out at `now`, nanoseconds."""
        return self._faults.unplugged(now)

    def on_cable(self, callback: Callable[[], None]) -> None:
        """Call it, also from another thread, when `fail` may have pulled the cable out."""
        self._look = weakref.WeakMethod(callback)

    def _begin(self, now: int) -> int:
        """The first time that it is spoken to: its time begins, and the loop's clock becomes fast.

        Returns the time, which begins in another loop where it ended in the one before: that clock was fast.
        """
        before, self._now = self._now, now
        if self._begins_at_once:
            self._faults.begin(max(before, now))
        if self._surroundings is not None:
            self._surroundings.begin(now)
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:  # a thread serves it
            return now
        if loop in self._clocks:
            return now
        self._clocks.add(loop)
        pace = self._pace
        if pace is None:
            pace = FAST if threading.current_thread() is threading.main_thread() else 1.0
        clock = clock_of(loop) if pace != 1.0 or before > now else None
        if clock is not None:
            clock.set(pace)
            if before > now:
                clock.skip((before - now) * 1e-9)
                self._now = now = before
        return now
