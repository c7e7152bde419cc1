"""The file of settings: where each lidar is mounted, what is left out of its scans, its speed, mode and frame.

docs/settings.md shows one. What the table of a lidar says takes the place of what ``[default]`` says, except for
filters: those of ``[default]`` come first, and then its own. The whole file is checked when it is read.
"""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from math import fmod, radians
from typing import Any, Final

import lidario.filters as filters
from lidario.basics.arguments import finite, path_of, shown
from lidario.basics.system import cause_of
from lidario.basics.whole_file import is_named_pipe
from lidario.errors import InvalidValue
from lidario.filters.base import Filter
from lidario.scans.points import Mount

MOST_BYTES: Final = 1 << 20
ENCODING: Final = "utf-8-sig"
"""UTF-8, also with the byte order mark that programs on Windows put in front."""
FILTERS: Final[Mapping[str, type[Filter]]] = {
    name: getattr(filters, name) for name in filters.__all__ if name not in ("Filter", "MaskFilter")
}
"""Those that a file may name: all of `lidario.filters` but the bases for others."""
_KEYS: Final = ("mount", "frame", "mode", "speed_rpm", "filters")
_PLACES: Final = ("x", "y", "yaw_deg")


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """The settings of one lidar.

    Attributes:
        mount: Where it is on the robot; None where the file does not say.
        frame: Name of its coordinate frame, for ROS; None where the file does not say.
        mode: Scan mode by name or id, for readers that ask for none; None for the typical one.
        speed_rpm: Revolutions a minute that are set when it is opened; None to leave the speed alone.
        filters: What all its scans and sectors pass, in this order, before the filters of a reader.
    """

    mount: Mount | None = None
    frame: str | None = None
    mode: str | int | None = None
    speed_rpm: float | None = None
    filters: tuple[Filter, ...] = ()


@dataclass(frozen=True, slots=True)
class Config:
    """The settings of all lidars; `read_config` makes it.

    Attributes:
        path: The file; empty for none.
        default: The settings of a lidar that has no table of its own.
        lidars: Those of each lidar that has one, by its serial number in lower case.
    """

    path: str = ""
    default: LidarConfig = LidarConfig()
    lidars: Mapping[str, LidarConfig] = field(default_factory=dict)

    def of(self, serial: str) -> LidarConfig:
        """The settings of the lidar with this serial number."""
        return self.lidars.get(serial.casefold(), self.default)


def read_config(path: str | os.PathLike[str]) -> Config:
    """Read a file of settings.

    Args:
        path: The file, in TOML.

    Raises:
        InvalidValue: It cannot be read, or something in it cannot be right; the text says where, and what can be.
    """
    name = str(path_of(path, "a file of settings"))
    try:
        if is_named_pipe(name):
            raise InvalidValue(f"{name}: the file of settings cannot be read: it is a pipe (FIFO)")
        with open(name, "rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InvalidValue(f"{name}: the file of settings cannot be read: {cause_of(error)}") from error
    return config_of(tables_of(data, name), name)


def config_of(tables: dict[str, Any], name: str) -> Config:
    """The settings that the tables of the file `name` say; InvalidValue where something in them cannot be right."""
    _known(tables, ("default", "lidars"), name)
    default = _table(tables.get("default", {}), f"{name}: [default]")
    lidars = _table(tables.get("lidars", {}), f"{name}: [lidars]")
    found: dict[str, LidarConfig] = {}
    for serial, table in lidars.items():
        place = f"{name}: [lidars.{serial}]"
        if serial.casefold() in found:
            raise InvalidValue(f"{place}: this serial number is there twice")
        found[serial.casefold()] = _lidar(default, _table(table, place), name, place)
    return Config(name, _lidar({}, default, name, f"{name}: [default]"), found)


def as_config(config: Config | str | os.PathLike[str] | None) -> Config:
    """Settings as a user gives them: read already, or the name of the file, or none. Raises as `read_config`."""
    if config is None:
        return Config()
    return config if isinstance(config, Config) else read_config(config)


def tables_of(data: bytes, name: str) -> dict[str, Any]:
    """The tables that the bytes of the file `name` hold; InvalidValue where they are too many, or no TOML."""
    if len(data) > MOST_BYTES:
        raise InvalidValue(f"{name} has more than {MOST_BYTES} bytes: that is no file of settings")
    try:
        return tomllib.loads(data.decode(ENCODING))
    except UnicodeDecodeError as error:
        raise InvalidValue(f"{name} is no text in UTF-8, from byte {error.start} on") from None
    except ValueError as error:
        raise InvalidValue(f"{name} is no TOML: {error}") from None
    except RecursionError:
        raise InvalidValue(f"{name}: lists or tables are nested too deeply") from None


def _lidar(default: dict[str, Any], own: dict[str, Any], name: str, place: str) -> LidarConfig:
    _known(own, _KEYS, place)
    said = default | own
    mount = _mount(said["mount"], f"{place}: mount") if "mount" in said else None
    frame, mode, speed = said.get("frame"), said.get("mode"), said.get("speed_rpm")
    if frame is not None and (not isinstance(frame, str) or not frame):
        raise InvalidValue(f'{place}: frame is the name of a frame, such as "laser", not {shown(frame)}')
    if mode is not None and (isinstance(mode, bool) or not isinstance(mode, str | int)):
        raise InvalidValue(f"{place}: mode is the name of a scan mode or its number, not {shown(mode)}")
    if speed is not None:
        speed = _number(speed, f"{place}: speed_rpm")
        if speed <= 0:
            raise InvalidValue(f"{place}: speed_rpm is revolutions a minute, above 0, not {speed:g}")
    whose = (f"{name}: [default]", default), (place, own)
    made = [
        parse_filter(each, mount, f"{where}: filter {number}")
        for where, table in whose
        for number, each in enumerate(_list(table.get("filters", []), where), 1)
    ]
    return LidarConfig(mount, frame, mode, speed, tuple(made))


def _mount(value: object, place: str) -> Mount:
    table = _table(value, place)
    _known(table, _PLACES, place)
    x, y, yaw = (_number(table.get(each, 0.0), f"{place}: {each}") for each in _PLACES)
    try:
        return Mount(x, y, radians(fmod(yaw, 360.0)))
    except InvalidValue as error:
        raise InvalidValue(f"{place}: {error}") from None


def parse_filter(value: object, mount: Mount | None, place: str) -> Filter:
    """The filter that a table of the file says; InvalidValue where it says none, or one that cannot be.

    Filters that must know where the lidar is get its `mount`. `place` is where the table stands in the file.
    """
    table = dict(_table(value, place))
    kind = table.pop("filter", None)
    if not isinstance(kind, str) or kind not in FILTERS:
        raise InvalidValue(f"{place}: filter is one of {', '.join(sorted(FILTERS))}, not {shown(kind)}")
    made = FILTERS[kind]
    # `fields` of a dataclass; the base class says nothing of it.
    about = {each.name: each for each in fields(made)}  # type: ignore[arg-type]
    placed = about.pop("mount", None) is not None
    _known(table, tuple(about), f"{place}: {kind}")
    missing = [each for each, of in about.items() if of.default is MISSING and each not in table]
    if missing:
        raise InvalidValue(f"{place}: {kind} needs {' and '.join(missing)}")
    if placed and mount is not None:
        table["mount"] = mount
    try:
        return made(**table)
    except InvalidValue as error:
        raise InvalidValue(f"{place}: {kind}: {error}") from None


def _known(table: dict[str, Any], names: tuple[str, ...], place: str) -> None:
    for each in table:
        if each not in names:
            raise InvalidValue(f"{place}: {shown(each)} means nothing here; there are {', '.join(names)}")


def _table(value: object, place: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InvalidValue(f"{place} is a table, not {shown(value)}")
    return value


def _list(value: object, place: str) -> list[object]:
    if not isinstance(value, list):
        raise InvalidValue(f"{place}: filters are a list, each written as [[….filters]], not {shown(value)}")
    return value


def _number(value: object, what: str) -> float:
    # A number in TOML is a number here; `finite` would take true for 1.
    if isinstance(value, bool):
        raise InvalidValue(f"{what} is a number, not {shown(value)}")
    return finite(value, what)
