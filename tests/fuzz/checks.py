"""What holds of every scan, text and error, whatever the bytes were."""

from __future__ import annotations

import numpy as np

import lidario

_LONGEST_TEXT = 300


def check_scan(scan: lidario.Scan) -> None:
    """Its arrays have one length, angles in [0, 360) and in [-pi, pi], distances from 0 on."""
    assert len(scan) == len(scan.angles) == len(scan.device_angles) > 0
    assert ((scan.device_angles >= 0) & (scan.device_angles < 360)).all()
    assert (np.abs(scan.angles) <= np.float32(np.pi)).all()
    assert (scan.device_distances >= 0).all()
    assert (np.isnan(scan.ranges) == ~scan.valid).all()
    assert scan.lost_packets >= 0
    assert scan.duration_ns >= 0
    assert np.isnan(scan.rpm) or scan.rpm > 0
    scan.to_laserscan()


def check_error(error: lidario.LidarError) -> None:
    """It is no mistake of ours, and a terminal can show its text."""
    if isinstance(error, lidario.InternalError):
        raise AssertionError(f"a mistake of ours: {error.__cause__!r}") from error
    assert str(error).replace("\n", "").isprintable(), ascii(error)


def check_text(text: str) -> None:
    """A terminal can show it, and it is short."""
    assert text.isprintable(), ascii(text)
    assert len(text) <= _LONGEST_TEXT
