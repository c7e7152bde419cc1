"""What the package page shows: README and addresses, made when the package is built.

The address of the repository is that of where it is built: ``GITHUB_SERVER_URL`` and ``GITHUB_REPOSITORY``, as CI
sets them, or ``LIDARIO_REPOSITORY``. Then the links and pictures of README lead there, since a package page has
none of its files. Where no address is known, as in a clone on a robot, README stays as it is.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

ROOT = Path(__file__).parent


class PackagePage(MetadataHookInterface):
    """Fills in ``readme`` and ``urls``."""

    def update(self, metadata: dict[str, Any]) -> None:
        """As `MetadataHookInterface.update`."""
        text, address = (ROOT / "README.md").read_text(encoding="utf-8"), repository()
        if address:
            metadata["urls"] = {
                "Source": address,
                "Documentation": f"{address}/tree/HEAD/docs",
                "Changelog": f"{address}/blob/HEAD/CHANGELOG.md",
                "Issues": f"{address}/issues",
            }
            text = absolute(text, address)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def repository() -> str:
    """Where the repository is, without a slash at its end; empty where that is not known."""
    name = os.environ.get("GITHUB_REPOSITORY", "")
    known = f"{os.environ.get('GITHUB_SERVER_URL', 'https://github.com')}/{name}" if name else ""
    return os.environ.get("LIDARIO_REPOSITORY", known).rstrip("/")


def absolute(text: str, address: str) -> str:
    """A Markdown text whose pictures and links lead to the repository, wherever they led to one of its files."""
    text = re.sub(r"(!\[[^]]*\])\((?![a-z]+:)([^)]+)\)", rf"\1({address}/raw/HEAD/\2)", text)
    return re.sub(r"(?<!!)(\[[^]]*\])\((?![a-z]+:|#)([^)]+)\)", rf"\1({address}/blob/HEAD/\2)", text)
