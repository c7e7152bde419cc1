"""The families by name: the only place that lists vendors. A new family is a folder here and a row below."""

from difflib import get_close_matches

from lidario.basics.arguments import text_of
from lidario.basics.source import Source, quoted
from lidario.errors import ConnectFailed, InvalidValue
from lidario.families import camsense, hlds, hokuyo, irobotix, ldrobot, neato, rplidar, ydlidar
from lidario.families.base import Family

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
"""In the order in which the device at an unknown port is asked. `rplidar` comes before `ydlidar`: the first request
of the second means something else to the first. `hokuyo` speaks lines of text: to it, the requests of the families
before are a half written line, which its own request ends. `hlds` comes after it, because it is woken by a letter,
which must not get into that line. Families that hear nothing are found by listening, so their place does not
matter."""


def family_named(name: str) -> Family:
    """The family of that name. ConnectFailed (reason ``source``) if there is none, InvalidValue for no text."""
    text_of(name, "the name of a family")
    for family in FAMILIES:
        if family.name == name:
            return family
    known = ", ".join(family.name for family in FAMILIES)
    raise ConnectFailed(f"there is no lidar family {quoted(name)}; known are {known}", reason="source")


def family_of_simulated(model: str) -> Family:
    """The family that has a simulated `model`; ConnectFailed (reason ``source``) if none has."""
    text_of(model, "the name of a simulated model")
    for family in FAMILIES:
        # The name is compared first, so that the simulated devices of other families are not loaded.
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
    """The families that have a model of that name, in lower case; ConnectFailed (reason ``source``) if none has.

    If a `family` was named too, only that one is searched.
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
    """Check the names in a source, and the family named beside the source, before anything is opened.

    Raises:
        ConnectFailed: With reason ``source``: a family or model is unknown, or the source names another family than
            that of its device. The text lists the known names, or the nearest ones.
        InvalidValue: The source is of another family than the one named beside it.
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
    """Check that the family that a user names is the device's `own`, which is None or empty if unknown.

    Raises:
        ConnectFailed: With reason ``source``: the source names another family.
        InvalidValue: Another family was named beside the source.
    """
    if own and family not in (None, own):
        raise InvalidValue(f"family={family!r} is not right: {quoted(source.text)} is of the family {own!r}")
    if own and source.family not in (None, own):
        raise ConnectFailed(f"{quoted(source.text)} is of the family {own!r}", reason="source")
