"""A device that tells a zero-angle offset."""

from typing import Any

import pytest

from lidario.families.ydlidar.simulated.device import Simulated4Ros


@pytest.fixture
def calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulated devices of the other family tell a zero-angle offset of 10.5 degrees."""
    make = Simulated4Ros.__init__

    def with_offset(device: Simulated4Ros, *arguments: Any, **more: Any) -> None:
        make(device, *arguments, **more)
        device.zero_offset = 42

    monkeypatch.setattr(Simulated4Ros, "__init__", with_offset)
