"""Writing into the file of settings: what was there stays as it was written, with its comments."""

import os
from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import fields
from itertools import takewhile
from math import degrees
from pathlib import Path
from typing import Any, Final, cast

from lidario.basics.arguments import path_of, shown, text_of
from lidario.basics.system import cause_of
from lidario.basics.whole_file import whole_file
from lidario.config.read import ENCODING, FILTERS, config_of, parse_filter, read_config, tables_of
from lidario.errors import InvalidValue, Unsupported
from lidario.filters.base import Filter
from lidario.scans.points import Mount

_CANNOT: Final = (
    "this cannot be written into it as it is. Give each lidar a table of its own, such as [lidars.AB12], with its "
    "filters right below, in place of braces and keys with dots"
)
_DIGITS: Final = 4  # behind the point: tenths of a millimetre, and less than a hundredth of a degree


def save_config(
    path: str | os.PathLike[str],
    serial: str,
    *,
    mount: Mount | None = None,
    filters: Iterable[Filter] = (),
    without: Iterable[Filter] = (),
) -> None:
    """Write into the file of settings where a lidar is mounted, and what is left out of its scans.

    The file is made where there is none. All else in it stays as it is, comments too. It is replaced in one step: a
    reader finds the file from before, or the whole new one.

    Args:
        path: The file.
        serial: Serial number of the lidar; empty for ``[default]``, which is for all lidars.
        mount: Where it is on the robot; None to leave that as it is.
        filters: Filters of `lidario.filters`, added behind those that it has. The mount of a box or a polygon is
            not written: in a file it is that of the lidar.
        without: Filters that are taken away, where they stand there: of this lidar, or of ``[default]``, and then
            of every lidar.

    Raises:
        InvalidValue: What is there already is wrong, or written in a way that cannot take more; the file cannot be
            written; or a filter is none of those. The file is as it was.
        Unsupported: ``tomlkit`` is not installed.
    """
    name, serial = str(path_of(path, "a file of settings")), text_of(serial, "a serial number")
    if mount is not None and not isinstance(mount, Mount):
        raise InvalidValue(f"mount is a Mount, not {shown(mount)}")
    try:
        import tomlkit
    except ModuleNotFoundError:
        raise Unsupported("writing settings needs tomlkit, which is not installed: pip install tomlkit") from None
    added = [_table_of(each) for each in _tuple_of(filters)]
    gone = [_table_of(each) for each in _tuple_of(without)]
    before = _read(name)
    tables = tables_of(before, name)
    _edit(tables, serial, mount, added, gone)
    wanted = config_of(tables, name)
    try:
        document = tomlkit.parse(before.decode(ENCODING))
        _edit(document, serial, mount, added, gone)
        after = document.as_string().encode()
        said = config_of(tables_of(after, name), name)
    except (LookupError, ValueError) as error:
        raise InvalidValue(f"{name}: {_CANNOT}") from error
    # tomlkit may leave something out, or put it elsewhere, and say nothing.
    if said.default != wanted.default or any(said.of(each) != wanted.of(each) for each in wanted.lidars):
        raise InvalidValue(f"{name}: {_CANNOT}")
    _replace(Path(name), after)


def _tuple_of(filters: Iterable[Filter]) -> tuple[Filter, ...]:
    try:
        return tuple(filters)
    except TypeError:
        raise InvalidValue(f"filters are a list, not {shown(filters)}") from None


def _read(name: str) -> bytes:
    """What the file holds, or a new one shall; whatever is wrong with it is said before anything is changed."""
    if not os.path.exists(name):
        return b"# Settings of lidars: docs/settings.md says what may stand here.\n"
    read_config(name)
    return Path(name).read_bytes()


def _edit(
    document: MutableMapping[str, Any], serial: str, mount: Mount | None, added: list[Any], gone: list[Any]
) -> None:
    """Make the changes in the tables of the file, or in its text."""
    table = _own_table(document, serial)
    for each in (table, document.get("default", {})) if gone else ():
        _take_away(each, gone)
    if mount is not None:
        table["mount"] = _inline(_place(mount))
    for each in added:
        _add(table, each)


def _take_away(table: Any, gone: list[Any]) -> None:
    """Take away the filters that are written like one of these."""
    kept = table.get("filters", [])
    for at in reversed(range(len(kept))):
        if _table_of(parse_filter(kept[at], None, "")) not in gone:
            continue
        behind = _comments_behind(kept[at], table)
        del kept[at]
        if at == 0 and (behind or not kept):
            del table["filters"]
        for each in behind:
            (kept[at - 1] if at else table).value.append(None, each)
        if "filters" not in table and kept:
            table["filters"] = kept


def _comments_behind(made: Any, table: Any) -> list[Any]:
    """Blank lines and comments at the end of a filter: they may belong to what follows, as that of the next table.

    None where the filter is written in braces, or the table of the lidar in several pieces.
    """
    from tomlkit.items import Table

    if not (isinstance(made, Table) and isinstance(table, Table)):
        return []
    return [item for _, item in reversed(list(takewhile(lambda each: each[0] is None, reversed(made.value.body))))]


def _own_table(document: MutableMapping[str, Any], serial: str) -> MutableMapping[str, Any]:
    import tomlkit

    tables, key = document, "default"
    if serial:
        if "lidars" not in document:
            document["lidars"] = tomlkit.table(is_super_table=True)
        tables = document["lidars"]
        # As the file writes it.
        key = next((each for each in tables if each.casefold() == serial.casefold()), serial)
    if key not in tables:
        tables[key] = tomlkit.table()
    return cast("MutableMapping[str, Any]", tables[key])


def _add(table: MutableMapping[str, Any], made: Any) -> None:
    import tomlkit
    from tomlkit.items import Array

    filters = table.setdefault("filters", tomlkit.aot())
    if isinstance(filters, Array):
        # Written in one line, as `filters = [{…}]`: a table of its own cannot stand there.
        made = _inline(made.unwrap())
    filters.append(made)


def _table_of(made: Filter) -> Any:
    import tomlkit

    if FILTERS.get(type(made).__name__) is not type(made):
        raise InvalidValue(f"a file of settings has filters of lidario.filters, not {shown(made)}")
    table = tomlkit.table()
    table["filter"] = type(made).__name__
    for each in fields(made):  # type: ignore[arg-type] # all of them are records
        value = getattr(made, each.name)
        if each.name != "mount" and value != each.default:
            table[each.name] = _plain(value)
    return table


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    # Adding 0.0 makes the negative zero that rounding leaves an ordinary one.
    return round(value, _DIGITS) + 0.0 if isinstance(value, float) else value


def _place(mount: Mount) -> dict[str, float]:
    place = {"x": mount.x, "y": mount.y, "yaw_deg": degrees(mount.yaw)}
    return {name: _plain(float(value)) for name, value in place.items()}


def _inline(values: Mapping[str, Any]) -> Any:
    import tomlkit

    table = tomlkit.inline_table()
    table.update(values)
    return table


def _replace(path: Path, data: bytes) -> None:
    try:
        with whole_file(path) as part:
            if path.exists():
                os.chmod(part, path.stat().st_mode & 0o777)
            with open(part, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
    except OSError as error:
        raise InvalidValue(f"{path}: the settings cannot be written: {cause_of(error)}") from error
