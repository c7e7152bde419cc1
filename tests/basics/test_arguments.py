"""Every public function with every kind of wrong value: it works, or says what is wrong by an error of lidario."""

import inspect
from collections.abc import Callable, Coroutine
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidario
from lidario.basics.arguments import finite, number, path_of, shown, text_of, whole, yes_or_no
from lidario.filters import BoxFilter
from lidario.ros import Fleet, Publisher, Share, pointcloud2
from lidario.scans.merging import Merged, MergedScans
from lidario.testing import Body, RecordedLidar, SimulatedLidar, make_scan, make_sector, room
from tests.filters.calls import filter_calls
from tests.support.devices import both_families, make_rig, take
from tests.support.loop import driven


class NamedByBytes:
    def __fspath__(self) -> bytes:
        return b"/dev/ttyUSB0"


class NamedByNothing:
    def __fspath__(self) -> int:
        return 3


WRONG: list[Any] = [
    *(None, True, np.True_, 0, -1, 2, 1.5, 10**400, -(10**5000), 1j, np.int64(5), np.float32("nan"), np.float64(9)),
    *(1e39, -1e39, 1e308, 1e19, -0.0, 5e-324, np.float64(1e200), 10**40, Fraction(1, 3)),
    *(float("nan"), float("inf"), float("-inf"), np.array(1.0), np.array([1.0, 2.0]), np.array([])),
    *("", "x", "1", "\0", "\ud800", "ß" * 1000, "\n", b"", b"x", bytearray(b"x"), np.str_("x")),
    *([], [1], (), (1.0, 2.0), (1.0, float("nan")), ("a", "b"), (10**400, 1), [[1, 2], [3]], {}, {"a": 1}, set()),
    *(object(), object, ..., Path("/nonexistent/x"), Path("a\0b"), Path("\ud800")),
    *(NamedByBytes(), NamedByNothing()),
]
"""Some of them are right for some arguments. What follows says only that none makes a foreign exception leave."""

SCAN = make_scan([-0.1, 0.0, 0.1], [1.2, 0.4, 1.3])
SECTOR = make_sector([-0.1, -0.2], [1.0, 2.0])


CLOUD = np.random.default_rng(1).uniform(-2.0, 2.0, (60, 2))
EMPTY = np.zeros((0, 2), np.float32)
SEEN = Merged(lidario.merge(), 0, 0, 0.1, (), 12.0, EMPTY, EMPTY)
TWO: dict[str, Any] = {"angles": [0.1, 0.2], "ranges": [1.0, 2.0]}


def each(function: Callable[..., object], *, but: str = "", **right: Any) -> dict[str, Callable[[Any], object]]:
    """By name, such as ``simulate(seed)``: a call for each argument but one, with the `right` values for others."""
    return {
        f"{function.__qualname__}({name})": partial(with_one, function, right, name)
        for name, argument in inspect.signature(function).parameters.items()
        if argument.kind is not argument.VAR_POSITIONAL and name != but
    }


def with_one(function: Callable[..., object], right: dict[str, Any], name: str, value: object) -> object:
    return function(**{**right, name: value})


async def nothing() -> None: ...


def embodied(path: Any = ((0, 1, 0),), radius: Any = 0.2) -> object:
    return SimulatedLidar(bodies=[Body(path, radius)])


def walled(width: Any = 4.0, depth: Any = 4.0) -> object:
    return SimulatedLidar(walls=room(width, depth))


def placed(x: Any = 0.1, y: Any = 0.1, yaw: Any = 0.1) -> object:
    mount = lidario.Mount(x, y, yaw)
    lidario.looseness(CLOUD, CLOUD, lidario.Registration(mount, 0.01, 1.0, 0.0))
    return SCAN.filtered(BoxFilter(0.0, 1.0, 0.0, 1.0, mount=mount)).points(mount)


def moved(x: Any = 0.1, y: Any = 0.1, yaw: Any = 0.1, at_ns: Any = 10**18) -> object:
    return SCAN.points(motion=lidario.Velocity(x, y, yaw), at_ns=at_ns)


CALLS: dict[str, Callable[[Any], object]] = {
    **each(lidario.open_lidar, source=lidario.simulate()),
    **each(lidario.simulate),
    **each(lidario.Reconnect),
    **each(lidario.Mount),
    **each(lidario.Velocity),
    **each(SCAN.nearest),
    **each(SECTOR.nearest),
    **each(SCAN.select),
    **each(SCAN.at, angle=0.0),
    **each(SCAN.points, motion=lidario.Velocity(x=1.0)),
    # What a function of the user raises is no error of ours.
    "Scan.points(motion)": lambda value: None if callable(value) else SCAN.points(motion=value),
    **each(placed),
    **each(moved),
    **each(SCAN.to_laserscan),
    **each(lidario.LaserScans),
    "Scan.filtered(filters)": lambda value: SCAN.filtered(lambda _: value),
    "Scan.filtered(what is none)": lambda value: None if callable(value) else SCAN.filtered(value),
    "Sector.filtered(filters)": lambda value: SECTOR.filtered(lambda _: value),
    **filter_calls(SCAN),
    **each(lidario.LaserScan.from_cdr),
    "merge(clouds)": lidario.merge,
    "merged(lidars)": lidario.merged,
    **each(lidario.merged),
    **each(MergedScans, but="mounts", mounts=[lidario.Mount()]),
    **each(SEEN.to_laserscan),
    **each(lidario.read_config),
    **each(lidario.save_config, path="/dev/null/x", serial="serial"),
    **each(lidario.register, first=CLOUD, second=CLOUD),
    **each(
        lidario.looseness, first=CLOUD, second=CLOUD, found=lidario.Registration(lidario.Mount(), 0.01, 1.0, 0.0)
    ),
    "run(main)": lidario.run,
    "run(debug)": lambda value: lidario.run(nothing(), debug=value),
    **each(lidario.decode, data=b""),
    **each(lidario.decode_arrays, data=b""),
    **each(lidario.decode_file, path="raw.bin"),
    **each(lidario.decode_file_arrays, path="raw.bin"),
    **each(lidario.summarize, path="raw.bin"),
    **each(make_scan, **TWO),
    **each(make_sector, **TWO),
    **each(SimulatedLidar),
    **each(SimulatedLidar().show),
    **each(embodied),
    **each(walled),
    **each(RecordedLidar),
    **each(pointcloud2, scan=SCAN),
    **each(Publisher, lidar=None),
    **each(Share, but="raw", lidar=None, key="robots/r7/scan"),
    **each(Fleet, keys="robots/*/scan"),
}


ASYNCHRONOUS = {"list_lidars", "list_serial_ports"}
AS_ANOTHER = {"open_sync": "open_lidar"}


def test_every_argument_of_every_public_function_is_tried() -> None:
    public = {name: getattr(lidario, name) for name in lidario.__all__}
    functions = [each for each in (*public.values(), *vars(lidario.Scan).values()) if inspect.isfunction(each)]
    wanted = {
        f"{AS_ANOTHER.get(function.__qualname__, function.__qualname__)}({argument})"
        for function in functions
        for argument in inspect.signature(function).parameters
        if function.__name__[0] != "_" and function.__name__ not in ASYNCHRONOUS and argument != "self"
    }
    assert len(wanted) > 60
    assert wanted <= set(CALLS), wanted - set(CALLS)


def tried(call: Callable[[Any], object], value: object) -> str | None:
    """What foreign exception leaves."""
    try:
        call(value)
    except lidario.LidarError as error:
        # Its text can be printed anywhere, and is no longer than a few lines.
        str(error).encode("utf-8")
        return f"{shown(value)}: {len(str(error))} characters" if len(str(error)) > 1500 else None
    except Exception as error:
        return f"{shown(value)}: {error!r}"[:200]
    return None


@pytest.mark.exhaustive("name", sample=CALLS)
def test_no_foreign_exception_leaves_a_function(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("raw.bin").write_bytes(bytes(10))
    left = [tried(CALLS[name], value) for value in WRONG]
    assert [each for each in left if each is not None] == []


async def tried_in_session(call: Callable[[Any], Coroutine[Any, Any, object]], value: object) -> str | None:
    try:
        await call(value)
    except (lidario.InternalError, lidario.SessionClosed) as error:
        return f"{shown(value)}: {error!r}"[:200]
    except lidario.LidarError:
        return None
    except Exception as error:
        return f"{shown(value)}: {error!r}"[:200]
    return None


@pytest.mark.long
@both_families
@driven
async def test_no_foreign_exception_leaves_a_session(family: str) -> None:
    """Nor does one end it: the streams are started by another task than the one that made the mistake."""
    rig = make_rig(family)
    left = []
    async with rig.open() as lidar:

        async def named(
            method: Callable[..., lidario.ScanStream | lidario.SectorStream], name: str, value: object
        ) -> None:
            stream = method(**{name: value})
            # What works is tried elsewhere. Here a wrong word must be refused where it is given, or when it starts.
            if name != "depth":
                await anext(stream)
            await stream.aclose()

        async def recorded(name: str, value: object) -> None:
            also = {"split_s": 60} if name == "keep_bytes" else {}
            arguments: dict[str, Any] = {"path": "x", **also, name: value}
            lidar.record(**arguments)

        async def tapped(value: Any) -> None:
            lidar.tap(value)
            lidar.untap(value)

        of_streams = ("mode", "depth", "force", "filters")
        of_recordings = ("path", "scans", "overwrite", "sync", "split_s", "split_bytes", "keep_bytes")
        settings = ("scan_frequency", "motor_speed", "zero_offset", "power_down_protection", "network_address")
        calls: dict[str, Callable[[Any], Coroutine[Any, Any, object]]] = {
            **{name: getattr(lidar, f"set_{name}") for name in (*settings, "baudrate")},
            **{f"scans({name})": partial(named, lidar.scans, name) for name in of_streams},
            **{f"sectors({name})": partial(named, lidar.sectors, name) for name in (*of_streams, "degrees")},
            **{f"record({name})": partial(recorded, name) for name in of_recordings},
            "tap": tapped,
        }
        for name, call in calls.items():
            for value in WRONG:
                error = await tried_in_session(call, value)
                if error is not None:
                    left.append(f"{name}: {error}")
        assert left == []
        # It has done no harm.
        assert len(await take(lidar, 1)) == 1


def test_a_function_that_was_not_called_is_no_program() -> None:
    async def main() -> None: ...

    with pytest.raises(lidario.InvalidValue, match=r"lidario\.run\(main\(\)\)"):
        lidario.run(main)  # type: ignore[arg-type]


async def test_no_loop_is_begun_where_one_runs() -> None:
    """As in a notebook."""

    async def main() -> None: ...

    with pytest.raises(lidario.LocalProtocolError, match=r"await main\(\)"):
        lidario.run(main())


async def test_one_port_is_no_list_of_ports() -> None:
    with pytest.raises(lidario.InvalidValue, match="takes a list of ports, not '/dev/ttyUSB0'"):
        await lidario.list_lidars("/dev/ttyUSB0")
    wrong: Any
    for wrong in (None, 3, [3], ["a\0b"], ["\ud800"], [b"/dev/ttyUSB0"]):
        with pytest.raises(lidario.InvalidValue):
            await lidario.list_lidars(wrong)


def test_speeds_and_delays_that_cannot_be() -> None:
    for arguments in ({"baudrate": 0}, {"baudrate": 2.5}, {"latency": -0.1}, {"latency": float("nan")}):
        with pytest.raises(lidario.InvalidValue, match=r"^(a baud rate|the latency) is a .*number"):
            lidario.open_lidar("/dev/ttyUSB0", **arguments)


def test_checks_say_what_is_wrong() -> None:
    checks: list[tuple[Callable[[Any, str], object], object, str]] = [
        (finite, "1", "x is a number, not '1'"),
        (finite, 10**400, "x is a finite number, not 1000"),
        (number, float("nan"), "x is a number, not nan"),
        (whole, 1.0, "x is a whole number, not 1.0"),
        (number, True, "x is a number, not True"),
        (finite, False, "x is a number, not False"),
        (whole, True, "x is a whole number, not True"),
        (yes_or_no, np.zeros(2), "x is True or False, not array"),
        (yes_or_no, "no", "x is True or False, not 'no'"),
        (yes_or_no, 60, "x is True or False, not 60"),
        (text_of, b"", "x is a text, not b''"),
        (path_of, "a\0b", r"x is the name of a file, not 'a\x00b'"),
        (path_of, "", "x is the name of a file, not ''"),
    ]
    for check, value, text in checks:
        with pytest.raises(lidario.InvalidValue) as caught:
            check(value, "x")
        assert str(caught.value).startswith(text)
        assert len(str(caught.value)) < 150
