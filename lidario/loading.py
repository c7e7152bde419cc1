"""Loading a module, or a public name, at its first use, so that a Ctrl-C meanwhile does no harm.

numpy cannot be imported again in a process where its first import was interrupted. Python raises KeyboardInterrupt
in the main thread alone, so there another thread imports it, and completes the import whatever ends the waiting.
This matters to programs that go on after a Ctrl-C: notebooks, and interactive interpreters.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import ModuleType


def keep(package: str, name: str, homes: "Mapping[str, tuple[str, ...]]") -> object:
    """For a package's ``__getattr__``: load a public name from its home, a module of lidario, and keep it there."""
    home = next((home for home, names in homes.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    value: object = getattr(load(f"lidario.{home}"), name)
    setattr(sys.modules[package], name, value)
    return value


def load(name: str) -> "ModuleType":
    """Import a module by its full name. A Ctrl-C meanwhile is raised behind the import, a second one at once."""
    if "numpy" in sys.modules:
        return import_module(name)
    # Only here: `import lidario` does without them.
    import threading

    from lidario.port.latch import Latch, start_apart

    if threading.current_thread() is not threading.main_thread():
        return import_module(name)
    found: list[ModuleType | BaseException] = []
    done = Latch()

    def run() -> None:
        try:
            found.append(import_module(name))
        except BaseException as error:
            found.append(error)
        finally:
            done.set()

    # No daemon: the interpreter must not end in the midst of an import.
    thread = threading.Thread(target=run, name="lidario: import")
    try:
        start_apart(thread.start, lambda _: done.set())
        done.wait()
    except KeyboardInterrupt:
        # A program that ends now waits for the import anyway. What that runs by `exec` would make Python forget
        # Ctrl-C, and the exit code would be another one.
        if thread.is_alive():
            done.wait()
        raise
    if not found:  # the system allows no more threads
        return import_module(name)
    (result,) = found
    if isinstance(result, BaseException):
        raise result
    return result
