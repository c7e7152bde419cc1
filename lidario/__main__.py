"""The command ``lidario``, also as ``python -m lidario``.

Only what must work before anything else is here: the version, which is asked for by scripts and must come at
once, and one sentence for those who installed the library without the command's extra. Everything else is in
`lidario.cli`.
"""

from __future__ import annotations

import sys

__all__ = ["main"]

NEEDED = ("click", "rich")
"""What the extra `cli` brings and every command needs."""
MISSING_EXTRA = 2


def main() -> int:
    """Run the command with the arguments of the process; returns the exit code."""
    if sys.argv[1:] == ["--version"]:
        from lidario import __version__

        sys.stdout.write(f"lidario {__version__}\n")
        return 0
    try:
        from lidario.cli.main import cli
    except KeyboardInterrupt:
        return 130
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in NEEDED:
            raise
        sys.stderr.write(
            f"error: the command needs {error.name}, which is not installed: pip install 'lidario-asyncio[cli]'\n"
        )
        return MISSING_EXTRA
    return cli.run(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
