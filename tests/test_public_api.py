"""What a user may rely on: the names, their documentation and types, and how little importing them costs."""

import inspect
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import lidario

PUBLIC = [
    "Busy",
    "ConnectFailed",
    "ConnectReason",
    "DeviceFault",
    "DeviceInfo",
    "DeviceLost",
    "Found",
    "Health",
    "HealthStatus",
    "InternalError",
    "InvalidValue",
    "LaserScan",
    "Lidar",
    "LidarError",
    "LocalProtocolError",
    "PortInfo",
    "ProtocolError",
    "RemoteProtocolError",
    "ResponseTimeout",
    "SampleRate",
    "Scan",
    "ScanMode",
    "ScanStream",
    "SessionClosed",
    "Stats",
    "StreamFailed",
    "Unsupported",
    "__version__",
    "list_lidars",
    "list_serial_ports",
    "open_lidar",
]
ALIASES = {"ConnectReason"}
"""Type aliases: they carry no docstring at run time."""
ERRORS = {
    "Busy": lidario.LidarError,
    "ConnectFailed": lidario.LidarError,
    "DeviceFault": lidario.LidarError,
    "DeviceLost": lidario.LidarError,
    "InternalError": lidario.LidarError,
    "InvalidValue": lidario.LidarError,
    "LocalProtocolError": lidario.ProtocolError,
    "ProtocolError": lidario.LidarError,
    "RemoteProtocolError": lidario.ProtocolError,
    "ResponseTimeout": lidario.LidarError,
    "SessionClosed": lidario.LidarError,
    "StreamFailed": lidario.LidarError,
    "Unsupported": lidario.LidarError,
}


def test_the_public_names() -> None:
    assert lidario.__all__ == PUBLIC == sorted(PUBLIC)
    for name in PUBLIC:
        assert hasattr(lidario, name)


@pytest.mark.parametrize("name", [name for name in PUBLIC if name not in {"__version__", *ALIASES}])
def test_everything_public_is_documented(name: str) -> None:
    thing = getattr(lidario, name)
    assert inspect.getdoc(thing)
    if not inspect.isclass(thing):
        return
    for member, value in vars(thing).items():
        method = callable(getattr(value, "__func__", value)) or isinstance(value, property)
        if method and not member.startswith("_"):
            assert inspect.getdoc(value), f"{name}.{member}"


def test_the_tree_of_exceptions() -> None:
    for name, parent in ERRORS.items():
        assert getattr(lidario, name).__bases__[0] is parent
    assert issubclass(lidario.ResponseTimeout, TimeoutError)
    assert lidario.LidarError.__bases__ == (Exception,)
    found = {name for name in PUBLIC if isinstance(getattr(lidario, name), type)}
    assert {n for n in found if issubclass(getattr(lidario, n), Exception)} == {*ERRORS, "LidarError"}


def test_types_are_shipped() -> None:
    spec = find_spec("lidario")
    assert spec is not None
    assert spec.origin is not None
    assert (Path(spec.origin).parent / "py.typed").is_file()


def in_a_fresh_interpreter(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    return done.stdout.strip()


EXTRAS = {"click", "rich", "mcap", "websockets", "zenoh", "rerun", "matplotlib", "lidario.cli"}
LOADED = "print(*sorted(sys.modules))"


def test_importing_costs_next_to_nothing() -> None:
    loaded = set(in_a_fresh_interpreter(f"import lidario, sys; {LOADED}").split())
    assert "lidario" in loaded
    assert not loaded & (EXTRAS | {"numpy", "serial", "anyio"})


def test_no_public_name_brings_an_extra_along() -> None:
    loaded = set(in_a_fresh_interpreter(f"from lidario import *; import sys; {LOADED}").split())
    assert {"numpy", "lidario.session.lidar"} <= loaded
    assert not loaded & EXTRAS
    # Nor the simulator, which only few need.
    assert not any(name.startswith("lidario.families") and ".simulated" in name for name in loaded)


def test_what_is_not_public_is_not_there() -> None:
    assert set(PUBLIC) <= set(dir(lidario))
    with pytest.raises(AttributeError, match="no attribute 'Assembler'"):
        lidario.Assembler  # noqa: B018


def test_the_version_is_three_numbers() -> None:
    assert len(lidario.__version__.split(".")) == 3
    assert all(part.isdigit() for part in lidario.__version__.split("."))
