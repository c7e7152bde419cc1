"""What a report says that was not known: models, firmware, modes, formats, and rules that are not held.

Known is what the simulated devices do, which were built from manuals and from bytes of real devices, and what
earlier reports told (`SEEN`).
"""

import asyncio
import json
from collections.abc import Iterable
from importlib.resources import files
from math import isclose
from typing import Final, NamedTuple

from lidario.basics.model import ScanMode
from lidario.conformance.report import Report
from lidario.conformance.rule import Outcome
from lidario.families.base import Family
from lidario.families.registry import FAMILIES
from lidario.port.simulation import simulate
from lidario.session.opening import open_lidar

SEEN: Final = "seen.json"
"""Beside this file: one entry for each report in the project's collection, written by its script."""
LIKE: Final = 0.01
"""Share by which times of a sample and distances differ before it is told: modes state them with few digits."""


class Seen(NamedTuple):
    """What one device said it is, with day, computer and adapter of the report, and who has sent it."""

    model: str
    firmware: str
    modes: tuple[ScanMode, ...]
    who: str = ""
    when: str = ""
    system: str = ""
    adapter: str = ""


def seen_reports() -> tuple[Seen, ...]:
    """What the reports in the project's collection told."""
    entries = json.loads((files("lidario.conformance") / SEEN).read_text(encoding="utf-8"))
    return tuple(Seen(**{**each, "modes": tuple(ScanMode(**mode) for mode in each["modes"])}) for each in entries)


async def known_of(family: str) -> tuple[Seen, ...]:
    """All that is known of a family: its simulated models, and the reports. Takes a few seconds."""
    models = [model for known in _named(family) for model in known.simulated]
    simulated = await asyncio.gather(*map(_of_simulated, models))
    return (*simulated, *seen_reports())


def _named(family: str) -> list[Family]:
    """The family of that name; none where a newer version has made a report of one."""
    return [known for known in FAMILIES if known.name == family]


async def _of_simulated(model: str) -> Seen:
    async with open_lidar(simulate(model, spin_up=0.0)) as lidar:
        info, modes = lidar.info, await lidar.get_modes()
    return Seen(info.model, info.firmware, tuple(modes))


def news_of(report: Report, known: Iterable[Seen]) -> list[str]:
    """What a report says that is not among what is known of its family, a line each."""
    info, lines = report.about.info, list[str]()
    alike = [each for each in known if each.model == info.model]
    if not alike:
        lines.append(f"model {info.model} (number {info.model_id}): nobody has reported or simulated one")
    elif all(each.firmware != info.firmware for each in alike):
        known_ones = ", ".join(sorted({each.firmware or "none told" for each in alike}))
        lines.append(f"firmware {info.firmware or 'none told'}: known of this model are {known_ones}")
    for mode in report.modes:
        same = [each for one in alike for each in one.modes if each.name == mode.name]
        lines += _news_of_mode(report, mode, same)
    lines += [f"not held: {each.rule}: {each.text}" for each in report.with_outcome(Outcome.BROKEN)]
    return lines


def _news_of_mode(report: Report, mode: ScanMode, known: list[ScanMode]) -> list[str]:
    if all(known.stream_in(mode) is None for known in _named(report.about.info.family)):
        return [f"mode {mode.name}: its format 0x{mode.response_type:02X} is not known to lidario"]
    if not known:
        return [f"mode {mode.name}: not known of this model"]
    lines = list[str]()
    if all(each.response_type != mode.response_type for each in known):
        others = ", ".join(sorted({f"0x{each.response_type:02X}" for each in known}))
        lines.append(f"mode {mode.name}: format 0x{mode.response_type:02X}, known is {others}")
    for what, own, others_have in (
        ("a sample takes {:.2f} us", mode.sample_us, [each.sample_us for each in known]),
        ("it sees {:g} m far", mode.max_distance, [each.max_distance for each in known]),
    ):
        if not any(isclose(own, other, rel_tol=LIKE) for other in others_have):
            others = ", ".join(f"{each:g}" for each in sorted(set(others_have)))
            lines.append(f"mode {mode.name}: {what.format(own)}, known: {others}")
    return lines
