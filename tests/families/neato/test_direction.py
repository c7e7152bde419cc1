"""A rotor that turns counter-clockwise: the same packets read in either sense are each other's mirror image."""

import dataclasses

import numpy as np
import pytest

import lidario
from lidario.families.neato.simulated import pack_packet
from lidario.revolution.whole import sectors_of
from lidario.scans.scan import Scan
from tests.families.neato.about import CASES, LAYOUTS
from tests.support.streams import assembled

PACKETS = CASES[0].packets
WITHOUT = {"none": (), "one": (130,), "at the seam": (89, 90, 91, 180), "many": range(3, 1600, 17)}
lost = pytest.mark.parametrize("gone", WITHOUT.values(), ids=list(WITHOUT))


def pairs(gone: object) -> list[tuple[Scan, Scan]]:
    """The scans of an XV-11, and those of an LDS02RR that sends the same."""
    raw = b"".join(packet for number, packet in enumerate(PACKETS) if number not in gone)  # type: ignore[operator]
    back, forth = (assembled(case, raw, 200).scans for case in (CASES[0], LAYOUTS[0]))
    assert len(back) == len(forth) >= 15
    return list(zip(back, forth, strict=True))


@lost
def test_angles_are_mirrored_and_times_are_not(gone: object) -> None:
    for one, other in pairs(gone):
        np.testing.assert_array_equal(one.device_angles, -other.device_angles % 360)
        np.testing.assert_array_equal(one.device_distances, other.device_distances)
        np.testing.assert_array_equal(one.times_ns, other.times_ns)
        assert (np.diff(one.times_ns) > 0).all()
        assert one.lost_packets == other.lost_packets


@lost
@pytest.mark.parametrize("seam", [0.0, 33.0])
def test_a_laser_scan_has_each_return_where_it_was_and_when(gone: object, seam: float) -> None:
    for one, other in pairs(gone)[:5]:
        if seam:
            one, other = (
                dataclasses.replace(
                    scan, device_angles=((scan.device_angles + turn) % 360).astype(np.float32), seam=turn % 360
                )
                for scan, turn in ((one, -seam), (other, seam))
            )
        back = one.to_laserscan(beams=360)
        forth = other.to_laserscan(beams=360)
        # Mirrored, what was measured first stands first.
        assert back.time_increment == pytest.approx(-forth.time_increment)
        assert back.angle_increment == forth.angle_increment
        at = {}
        for scan in (back, forth):
            angles = scan.angle_min + scan.angle_increment * np.arange(360)
            at[scan is back] = dict(zip(np.rint(np.degrees(angles) * 2) % 720, scan.ranges, strict=True))
        mirrored = {(-angle) % 720: distance for angle, distance in at[False].items()}
        assert at[True].keys() == mirrored.keys()
        # A sample stands between two beams, so that either of them may have it.
        same = np.array([at[True][key] for key in sorted(mirrored)])
        wanted = np.array([mirrored[key] for key in sorted(mirrored)])
        near = [np.roll(same, shift) for shift in (-1, 0, 1)]
        assert any(np.array_equal(each, wanted, equal_nan=True) for each in near)


def test_sectors_of_a_whole_scan_follow_the_rotor() -> None:
    for one, other in pairs((130,))[:3]:
        for back, forth in zip(sectors_of(one, 8), sectors_of(other, 8), strict=True):
            assert (back.index, len(back)) == (forth.index, len(forth))
            np.testing.assert_array_equal(back.times_ns, forth.times_ns)


def test_what_is_ahead_is_ahead() -> None:
    """A return at index 90 is to the left of an XV-11, and to the right of an LDS02RR."""
    raw = b"".join(
        pack_packet(n % 90, [1000.0 if n % 90 == 23 else 3000.0] * 4, [90] * 4) for n in range(90 * 3 + 5)
    )
    left, right = (next(iter(lidario.decode(raw, model=model))).nearest() for model in ("xv11", "lds02rr"))
    assert left is not None
    assert right is not None
    assert left.angle == pytest.approx(np.radians(92), abs=0.04)
    assert right.angle == pytest.approx(-np.radians(92), abs=0.04)
