"""Name -> family: the only place that lists vendors. A new one is a folder beside this file and a row here."""

from __future__ import annotations

from difflib import get_close_matches

from lidario.arguments import text_of
from lidario.errors import ConnectFailed, InvalidValue
from lidario.families import camsense, hlds, hokuyo, irobotix, ldrobot, neato, rplidar, ydlidar
from lidario.families.base import Family
from lidario.source import Source, quoted

FAMILIES: tuple[Family, ...] = (
    rplidar.FAMILY,
    ydlidar.FAMILY,
    ldrobot.FAMILY,
    neato.FAMILY,
    camsense.FAMILY,
    irobotix.FAMILY,
    hokuyo.FAMILY,
    hlds.FAMILY,
)
"""In the order in which an unknown port is asked. What the second one asks first means something else to the first.
`hokuyo` speaks lines of text: what the others were sent is to it a line half written, which its own question ends.
`hlds` is woken by a letter, which must not get into that line. Those that hear nothing are found by listening,
wherever they stand."""


def family_named(name: str) -> Family:
    """The family of that name; ConnectFailed (reason ``source``) when there is none, InvalidValue for no text."""
    text_of(name, "the name of a family")
    for family in FAMILIES:
        if family.name == name:
            return family
    known = ", ".join(family.name for family in FAMILIES)
    raise ConnectFailed(f"there is no lidar family {quoted(name)}; known are {known}", reason="source")


def family_of_simulated(model: str) -> Family:
    """The family that has a simulated `model`; ConnectFailed (reason ``source``) when none has."""
    text_of(model, "the name of a simulated model")
    for family in FAMILIES:
        # So that the simulated devices of other families are not loaded.
        if model.startswith(f"{family.name}-") and model in family.simulated:
            return family
    near = " or ".join(
        get_close_matches(model, (name for each in FAMILIES for name in each.simulated), cutoff=0.75)
    )
    if near:
        raise ConnectFailed(
            f"there is no simulated lidar {quoted(model)}. Did you mean {near}? `lidario sim --list` names all",
            reason="source",
        )
    models = "".join(f"\n  {family.title}: {', '.join(family.simulated)}" for family in FAMILIES)
    fault = (
        f"there is no simulated lidar {quoted(model)}; known are" if model else "name a model, as in sim://MODEL:"
    )
    raise ConnectFailed(f"{fault}{models}", reason="source")


def families_of_model(model: str, family: str | None = None) -> tuple[Family, ...]:
    """The families that have a model of that name, in lower case; ConnectFailed (reason ``source``) when none has.

    Only `family` is asked where one was named beside it.
    """
    asked = FAMILIES if family is None else (family_named(family),)
    found = tuple(each for each in asked if model in each.models)
    if found:
        return found
    known = "".join(f"\n  {each.title}: {', '.join(each.models)}" for each in asked if each.models)
    raise ConnectFailed(
        f"there is no model {quoted(model)} to be named; there are{known or ' none'}", reason="source"
    )


def check_source(source: Source, family: str | None = None) -> None:
    """Check the names in a source, and the family that was named beside it, before anything is opened.

    Raises:
        ConnectFailed: With reason ``source``: a family or model is unknown, or the source names a family that its
            device is not of. The text lists the known names, or the nearest ones.
        InvalidValue: The source is of another family than the one that was named beside it.
    """
    for name in (family, source.family):
        if name is not None:
            family_named(name)
    own = source.family
    if source.kind == "sim":
        own = family_of_simulated(source.address).name
    check_family(source, family, own)
    if source.model is not None:
        families_of_model(source.model, own or family)


def check_family(source: Source, family: str | None, own: str | None) -> None:
    """Check that the family that a user names is the device's `own`; None or empty where that is not known.

    Raises:
        ConnectFailed: With reason ``source``, where the source names another one.
        InvalidValue: Another one was named beside the source.
    """
    if own and family not in (None, own):
        raise InvalidValue(f"family={family!r} is not right: {quoted(source.text)} is of the family {own!r}")
    if own and source.family not in (None, own):
        raise ConnectFailed(f"{quoted(source.text)} is of the family {own!r}", reason="source")
