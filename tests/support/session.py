"""What is inside of an open session, for tests that look there or change something."""

from __future__ import annotations

from lidario import Lidar
from lidario.session.finding.connection import At
from lidario.session.finding.reconnect import Reconnector
from lidario.session.recorded import RecordedSession
from lidario.session.streaming.scanner import Scanner


def inside_of(lidar: Lidar) -> At:
    """The device as the session knows it, and the dialogue with it."""
    return lidar._at


def reconnector_of(lidar: Lidar) -> Reconnector:
    """What brings the session back."""
    found = lidar._reconnector
    assert found is not None
    return found


def recorded_of(lidar: Lidar) -> RecordedSession:
    """What hands the session to its recordings."""
    return lidar._recorded


def scanner_of(lidar: Lidar) -> Scanner:
    """What starts and stops the device, and hands its scans to the readers."""
    return lidar._scanner
