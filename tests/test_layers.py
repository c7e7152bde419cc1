"""Who may import whom, where a vendor may be named, how long a file may be: the architecture, held to by reading.

Thousands of tests run in the same process after these, so no syntax tree is kept.
"""

import ast
import re
import sys
from functools import cache
from pathlib import Path

import pytest

from lidario.families.registry import FAMILIES

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "lidario"
FILES = sorted(PACKAGE.rglob("*.py"))
VENDORS = sorted(path.name for path in (PACKAGE / "families").iterdir() if (path / "formats.py").is_file())

DRAWN = re.search(r"```\n(cli, .*?)```", (ROOT / "docs" / "architecture.md").read_text("utf-8"), re.DOTALL)
assert DRAWN is not None
LAYERS = [set(line.split("  ")[0].split(", ")) for line in reversed(DRAWN[1].splitlines())]
"""As they are drawn for those who read the code: each may import its own and those before it."""
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
OF_PORT = RANK["port"]
OF_SESSION = ("talking", "finding", "streaming", "")
"""The folders of the session, and what stands beside them: likewise."""

SANS_IO = {"asyncio", "anyio", "serial", "serial_asyncio", "socket", "select", "termios", "threading", "subprocess"}
OF_SYSTEM = {*SANS_IO, "io", "logging", "os", "pathlib", "random", "sys", "tempfile", "time"}
BESIDE_THE_PUBLIC_NAMES = {
    "cli": (
        "basics.system", "basics.words", "cli", "conformance", "families.adapters", "families.registry",
        "port.background", "recording", "ros", "sim", "web",
    ),
    "web": ("filters", "web"),
    "testing": ("basics.arguments", "conformance", "loading", "sim", "testing"),
}  # fmt: skip
"""What may be imported by those that else use the names that a user would."""
NAMES_OF_VENDORS = re.compile(
    "|".join((r"rp[ _-]?lidar|yd[ _-]?lidar|slamtec|(?<![a-z])4ros|yahboom|eai\b", *map(re.escape, VENDORS))),
    re.IGNORECASE,
)


def module(path: Path) -> str:
    """Dotted name, as in ``lidario.wire.link``; a package is its ``__init__``."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 2 else parts)


MODULES = {module(path) for path in FILES}


def layer(name: str) -> str:
    """The part of the package that a module belongs to."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


@cache
def imports(path: Path) -> tuple[tuple[str, bool], ...]:
    """Every module that a file imports, and whether for type checkers alone."""
    found: list[tuple[str, bool]] = []
    tree = ast.parse(path.read_text(encoding="utf-8"))
    branches = [
        node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
    ]
    typing = {node for branch in branches for part in branch.body for node in ast.walk(part)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, node in typing) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: relative import"
            assert node.module is not None
            found.append((node.module, node in typing))
            # A name may be a module of its own: from lidario.families import …
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found += [(name, node in typing) for name in names if name in MODULES]
    return tuple(found)


def ours(path: Path, *, typing: bool = True) -> set[str]:
    """Our modules that a file imports, anywhere in it; with or without those for type checkers alone."""
    return {name for name, alone in imports(path) if (typing or not alone) and name.split(".")[0] == "lidario"}


def foreign(path: Path) -> set[str]:
    return {name.split(".")[0] for name, _ in imports(path)} - {"lidario"}


def named(path: Path) -> str:
    return str(path.relative_to(PACKAGE))


def test_the_rules_see_the_whole_package() -> None:
    assert len(FILES) > 50
    assert {layer(module(path)) for path in FILES} == set(RANK)
    assert sorted(family.name for family in FAMILIES) == VENDORS
    assert {"ldrobot", "rplidar", "ydlidar"} <= set(VENDORS)
    # The reading itself: what is known to be imported is found.
    link = ours(PACKAGE / "wire" / "link.py")
    assert {"lidario.errors", "lidario.wire.blocks", "lidario.wire.formats"} <= link
    assert "lidario.families.rplidar" in ours(PACKAGE / "families" / "registry.py")
    assert "serial" in foreign(PACKAGE / "port" / "adapter.py")


@pytest.mark.long
def test_imports_point_one_way() -> None:
    for path in FILES:
        own = layer(module(path))
        for name in ours(path, typing=False):
            target = layer(name)
            assert RANK[target] <= RANK[own], f"{named(path)} imports {name}"
            if target == "__init__":
                assert own in ("web", "testing", "cli", "__main__"), f"{named(path)} imports the package as a whole"


def test_the_folders_of_the_session_import_one_way() -> None:
    def rank(name: str) -> int:
        folder = name.split(".")[2]
        return OF_SESSION.index(folder if folder in OF_SESSION else "")

    for path in (PACKAGE / "session").rglob("*.py"):
        for name in ours(path, typing=False):
            if name.startswith("lidario.session."):
                assert rank(name) <= rank(module(path)), f"{named(path)} imports {name}"


@pytest.mark.long
def test_input_and_output_begin_at_the_port() -> None:
    for path in FILES:
        if RANK[layer(module(path))] >= OF_PORT or named(path) in ("sim/serve.py", "sim/server.py"):
            continue
        assert not foreign(path) & (SANS_IO | {"logging", "time"}), named(path)


@pytest.mark.long
def test_serial_ports_are_known_where_they_are_opened_and_listed() -> None:
    users = {named(path) for path in FILES if foreign(path) & {"serial", "serial_asyncio"}}
    assert users == {"port/adapter.py", "port/serial.py", "session/finding/discovery.py"}


def test_the_wire_needs_the_standard_library_and_numpy() -> None:
    for path in sorted((PACKAGE / "wire").glob("*.py")):
        assert foreign(path) <= {*sys.stdlib_module_names, "numpy"} - OF_SYSTEM, named(path)
        assert {layer(name) for name in ours(path)} <= {"wire", "errors"}, named(path)


def test_a_family_knows_no_other() -> None:
    for path in [path for path in FILES if "families" in path.parts]:
        parts = module(path).split(".")
        own = parts[2] if len(parts) > 2 else ""
        others = {vendor for vendor in VENDORS if vendor != own}
        if own == "registry":
            continue
        for name in ours(path):
            assert not others & set(name.split(".")), f"{named(path)} imports {name}"


def test_the_registry_alone_lists_families() -> None:
    knowing = {
        named(path)
        for path in FILES
        for name in ours(path)
        for vendor in VENDORS
        if name.startswith(f"lidario.families.{vendor}") and vendor not in path.parts
    }
    assert knowing == {"families/registry.py"}


def is_device_side(path: Path) -> bool:
    return "sim" in path.parts or ("families" in path.parts and "simulated" in module(path).split("."))


def test_the_device_side_shares_nothing_with_the_host() -> None:
    """A mistake must be made twice to hide."""
    for path in [path for path in FILES if is_device_side(path)]:
        simulated = f"{module(path)}.".partition(".simulated.")[0] + ".simulated."
        for name in ours(path):
            assert f"{name}.".startswith(("lidario.sim.", simulated)), f"{named(path)} imports {name}"


def test_the_host_side_decodes_nothing_with_the_devices_packers() -> None:
    for path in [path for path in FILES if not is_device_side(path)]:
        assert not any(".simulated" in name and "families" in name for name in ours(path)), named(path)


@pytest.mark.parametrize("room", BESIDE_THE_PUBLIC_NAMES)
def test_it_uses_the_names_a_user_would(room: str) -> None:
    allowed = tuple(f"lidario.{name}." for name in BESIDE_THE_PUBLIC_NAMES[room])
    for path in sorted((PACKAGE / room).glob("*.py")):
        wrong = {name for name in ours(path) if name != "lidario" and not f"{name}.".startswith(allowed)}
        assert not wrong, f"{named(path)}: {wrong}"


# --------------------------------------------------------------------------------------------- vendors' names


def vendors_named(source: str) -> list[str]:
    """Every vendor's name in the source: in names, strings, docstrings and comments."""
    return [match.group() for match in NAMES_OF_VENDORS.finditer(source)]


@pytest.mark.long
def test_no_vendor_is_named_outside_the_families() -> None:
    for path in [path for path in FILES if "families" not in path.parts]:
        assert vendors_named(path.read_text(encoding="utf-8")) == [], named(path)


def test_vendors_are_found_wherever_they_stand() -> None:
    source = '"""For RPLIDAR."""\nx = f"sim://ydlidar-{x}"  # Slamtec\nclass YdLidarThing: pass\ny = "a 4ROS"\n'
    assert len(vendors_named(source)) >= 5
    assert vendors_named("import numpy  # errors, a lidar, YD, heading\n") == []


# --------------------------------------------------------------------------------------------- length of the files

MOST_LINES = 350


def too_long(root: Path) -> dict[str, int]:
    """Every Python file of the package, the tests and the benchmarks that has too many lines, and how many."""
    found = {}
    for folder in ("lidario", "tests", "benchmarks"):
        for path in sorted((root / folder).rglob("*.py")):
            lines = len(path.read_text(encoding="utf-8").splitlines())
            # `.peers` holds what the benchmarks install: it is not ours.
            if lines > MOST_LINES and ".peers" not in path.relative_to(root).parts:
                found[path.relative_to(root).as_posix()] = lines
    return found


@pytest.mark.long
def test_no_file_is_too_long_to_have_one_idea() -> None:
    assert too_long(ROOT) == {}


def test_a_file_that_is_too_long_is_found(tmp_path: Path) -> None:
    for name, lines in (("lidario/a/b.py", 350), ("tests/c.py", 351), ("benchmarks/.peers/x/d.py", 999)):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text("\n" * lines)
    assert too_long(tmp_path) == {"tests/c.py": 351}
