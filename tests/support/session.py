"""What is inside of an open session, for tests that look there or change something."""

from __future__ import annotations

from lidario import Lidar
from lidario.session.finding.connection import At
from lidario.session.recorded import RecordedSession
from lidario.session.streaming.scanner import Scanner

__all__ = ["inside_of", "recorded_of", "scanner_of"]


def inside_of(lidar: Lidar) -> At:
    """The device as the session knows it, and the dialogue with it."""
    return lidar._at


def recorded_of(lidar: Lidar) -> RecordedSession:
    """What hands the session to its recordings."""
    return lidar._recorded


def scanner_of(lidar: Lidar) -> Scanner:
    """What starts and stops the device, and hands its scans to the readers."""
    return lidar._scanner
