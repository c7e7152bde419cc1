"""What each family says of itself to the tests: its ``tests/families/NAME/about.py``, found by the registry."""

from importlib import import_module
from types import ModuleType

from lidario.families.registry import FAMILIES

ABOUT: dict[str, ModuleType] = {
    family.name: import_module(f"tests.families.{family.name}.about") for family in FAMILIES
}
"""By the name of the family. Each has ``MAKER``, ``CASES``, ``KINDS``, ``OF_GOLDEN_ALONE`` and ``MODELS``."""
