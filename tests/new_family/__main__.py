"""Begins a new family: ``python -m tests.new_family NAME``, in a clone of the repository.

It writes a family that works from the first minute: a device that only talks, its packets, its simulated device, a
scalar reference, a stream and tests, and its row in the registry. All of it is made up. Replace it part by part by
what the manual says, in the order of ``docs/new-family.md``; the tests stay green all the way. What is to be
replaced first says ``WRITE HERE``.

When packets have changed on both sides, ``python -m tests.new_family NAME --stream`` makes the stream anew.
"""

from __future__ import annotations

import argparse
import keyword
import re
import subprocess
import sys
from pathlib import Path

TEMPLATES = Path(__file__).resolve().parent
ROOT = TEMPLATES.parent.parent


def main() -> int:
    """Write a family; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.new_family", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("name", help="as in family=: small letters and digits, such as acme")
    parser.add_argument("--stream", action="store_true", help="make the stream of a family anew, and nothing else")
    asked = parser.parse_args()
    name = asked.name
    stream = ROOT / "tests" / "data" / f"{name}_first.npz"
    if asked.stream:
        if not (ROOT / "tests" / "reference" / f"{name}.py").exists():
            parser.error(f"there is no family {name!r} yet: the same without --stream begins one")
        made = subprocess.run([sys.executable, "-c", _STREAM.replace("newname", name), str(stream)], cwd=ROOT)
        return made.returncode
    try:
        written = begin_family(ROOT, name)
        # In a process of its own: this one has read the registry as it was.
        subprocess.run([sys.executable, "-c", _STREAM.replace("newname", name), str(stream)], cwd=ROOT, check=True)
        # The order of imports depends on the name.
        code = [str(path) for path in written]
        subprocess.run([sys.executable, "-m", "ruff", "check", "-q", "--fix", *code], cwd=ROOT, check=True)
        subprocess.run([sys.executable, "-m", "ruff", "format", "-q", *code], cwd=ROOT, check=True)
    except ValueError as error:
        parser.error(str(error))
    for path in (*written, stream):
        print(path.relative_to(ROOT))
    print(f"\nlidario scan sim://{name}-one -n 3        # works already\npython -m pytest tests/families/{name}")
    print("grep -rnI 'WRITE HERE' lidario/families      # what the manual must tell first: docs/new-family.md")
    return 0


def begin_family(root: Path, name: str) -> list[Path]:
    """Write the files of a family, and its row in the registry.

    Args:
        root: The clone.
        name: Its name.

    Returns:
        What was written.

    Raises:
        ValueError: The name cannot be one, or is taken.
    """
    if not re.fullmatch(r"[a-z][a-z0-9]{1,30}", name) or keyword.iskeyword(name):
        raise ValueError(f"{name!r} is no name of a family: small letters and digits, such as acme")
    family, tests = root / "lidario" / "families" / name, root / "tests"
    if (root / "lidario" / "families" / f"{name}.py").exists() or family.exists():
        raise ValueError(f"there is something called {name!r} in lidario/families already")
    places = {
        path: family / path.relative_to(TEMPLATES / "family").with_suffix("")
        for path in sorted((TEMPLATES / "family").rglob("*.txt"))
    }
    for path in sorted((TEMPLATES / "tests").glob("*.txt")):
        own = tests / "families" / name / path.stem
        places[path] = tests / "reference" / f"{name}.py" if path.stem == "reference.py" else own
    for template, path in places.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_named(template.read_text(encoding="utf-8"), name), encoding="utf-8")
    registry = root / "lidario" / "families" / "registry.py"
    registry.write_text(_with_row(registry.read_text(encoding="utf-8"), name), encoding="utf-8")
    return [*places.values(), registry]


def _named(text: str, name: str) -> str:
    return text.replace("newname", name).replace("Newname", name.capitalize()).replace("NEWNAME", name.upper())


def _with_row(registry: str, name: str) -> str:
    """The registry with a row at its end: one that is only heard may stand anywhere."""
    found = re.search(r"^from lidario\.families import (.+)$", registry, re.MULTILINE)
    rows = re.search(r"^FAMILIES: tuple\[Family, \.\.\.\] = \(\n(.+?)^\)$", registry, re.MULTILINE | re.DOTALL)
    if found is None or rows is None:
        raise ValueError("lidario/families/registry.py is not as it was: add the row by hand, and mend this script")
    imported = ", ".join(sorted([*found[1].split(", "), name]))
    return registry.replace(found[1], imported, 1).replace(rows[1], f"{rows[1]}    {name}.FAMILY,\n", 1)


_STREAM = """
import sys
from contextlib import suppress
import numpy as np
from lidario.families.newname.simulated import PROFILES, make_simulated
from tests.reference import newname

# Until the vendor's own program makes one: what the simulated device sends, as the scalar reference decodes it.
profile = next(iter(PROFILES.values()))
device = make_simulated(profile.name, seed=1)
device.spin_up_s = 0.0
device.transmit(0)
raw, size, packets = device.transmit(1_500_000_000), newname.PACKET_BYTES, []
for begin in range(size):
    # It is heard from the midst of a packet on.
    with suppress(ValueError):
        packets = newname.split(raw[begin:begin + (len(raw) - begin) // size * size])
        break
if not packets:
    sys.exit("the reference finds no packet in what the simulated device sends")
samples = newname.decode(packets)
np.savez_compressed(
    sys.argv[1],
    raw=np.frombuffer(b"".join(packets), np.uint8),
    angle_deg=np.array([each.angle_deg for each in samples], np.float32),
    distance_mm=np.array([each.distance_mm for each in samples], np.float32),
    intensity=np.array([each.quality for each in samples], np.uint8),
    sample_us=np.float64(1e6 / profile.rate),
)
"""


if __name__ == "__main__":
    sys.exit(main())
