"""Lines as the device writes them, from the SCIP 2.0 specification alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

_LINE = 64


def sealed(text: bytes) -> bytes:
    """A line with its check character and its end."""
    return text + bytes((sum(text) % 64 + 48,)) + b"\n"


def pack_status(echo: bytes, status: bytes) -> bytes:
    """A response that is a status alone."""
    return echo + b"\n" + sealed(status) + b"\n"


def pack_lines(echo: bytes, lines: Sequence[str], *, counts_semicolon: bool) -> bytes:
    """A response of lines such as ``MODL:URG-04LX``; the ``;`` behind each belongs to its sum or does not."""
    written = b""
    for line in lines:
        text = line.encode("ascii")
        written += sealed(text + b";") if counts_semicolon else text + b";" + sealed(text)[-2:]
    return echo + b"\n" + sealed(b"00") + written + b"\n"


def pack_block(echo: bytes, milliseconds: int, numbers: npt.NDArray[np.int64]) -> bytes:
    """One scan.

    Args:
        echo: The request, with the scans that are still to come at its end.
        milliseconds: The clock of the device.
        numbers: What was measured, in the order of the wire.
    """
    text = encoded(numbers, 3)
    lines = [sealed(text[at : at + _LINE]) for at in range(0, len(text), _LINE)]
    return echo + b"\n" + sealed(b"99") + pack_clock(milliseconds) + b"".join(lines) + b"\n"


def pack_clock(milliseconds: int) -> bytes:
    """The line that tells the clock."""
    return sealed(encoded(np.array([milliseconds]), 4))


def encoded(numbers: npt.NDArray[np.int64], width: int) -> bytes:
    """Numbers as so many characters each, of six bits, the most significant first."""
    digits = [numbers // 64 ** (width - 1 - place) % 64 + 48 for place in range(width)]
    return bytes(np.stack(digits, axis=1).astype(np.uint8).ravel())
