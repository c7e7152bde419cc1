"""The formats of `benchmarks.truth`, as models send them: with small packets and with large ones.

Samples are written by the packers of the simulated devices, and by the rules that their documents give: a packet
states where it begins, or each sample its angle; the corrections of single samples are those that a host takes off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.models import FORMATS as RELATIVES
from benchmarks.streams import RATES, Kind, rplidar_kind
from benchmarks.truth_code import Floats, Ints
from benchmarks.truth_streams import Form, Samples
from lidario.families.ldrobot import simulated as ldrobot
from lidario.families.rplidar.simulated import packers as rplidar
from lidario.families.rplidar.simulated.device import PROFILES
from lidario.families.rplidar.simulated.identity import pack_announcement
from lidario.families.rplidar.simulated.profile import Mode, Profile
from lidario.families.ydlidar.models import MODELS
from lidario.families.ydlidar.simulated import packers as ydlidar
from lidario.families.ydlidar.simulated.profiles import PROFILES as YDLIDARS
from lidario.families.ydlidar.simulated.profiles import Profile as YdlidarProfile


def _q6(turns: Floats) -> Ints:
    return np.floor(turns * 23040.0).astype(np.int64) % 23040


def _starts(samples: Samples) -> Ints:
    return _q6(samples.turns[:: len(samples.turns) // len(samples.sizes)])


def _equal(data: bytes, packets: int) -> tuple[bytes, Ints]:
    return data, np.full(packets, len(data) // packets)


def _begins(turns: Floats) -> NDArray[np.bool_]:
    whole = np.floor(turns)
    return np.diff(whole, prepend=whole[0]) > 0


_EXPRESS_OFFSETS_Q3 = np.array([18 + place % 5 for place in range(32)])


def _standard(samples: Samples) -> tuple[bytes, Ints]:
    words = np.rint(samples.millimetres * 4).astype(np.int64)
    data = rplidar.pack_standard(_q6(samples.turns), words, 40, _begins(samples.turns))
    return _equal(data, len(words))


def _express(samples: Samples) -> tuple[bytes, Ints]:
    count = len(samples.sizes)
    offsets = np.tile(_EXPRESS_OFFSETS_Q3, (count, 1))
    return _equal(rplidar.pack_express(_starts(samples), samples.rows(samples.millimetres), offsets), count)


def _hq(samples: Samples) -> tuple[bytes, Ints]:
    angle = np.floor(samples.turns % 1.0 * 65536.0).astype(np.int64) & 0xFFFF
    flags = np.where(_begins(samples.turns), 1, 2)
    stamp = (samples.times_ns[::96] * 1e-3).astype(np.uint64)
    rows = samples.rows
    words = rows(np.rint(samples.millimetres * 4).astype(np.int64))
    data = rplidar.pack_hq(rows(angle), words, np.full(words.shape, 200), rows(flags), time_us=stamp)
    return _equal(data, len(samples.sizes))


def _ultra(samples: Samples) -> tuple[bytes, Ints]:
    data = rplidar.pack_ultra(_starts(samples), samples.rows(samples.millimetres), float(samples.millimetres[-1]))
    return _equal(data, len(samples.sizes))


def _dense(samples: Samples) -> tuple[bytes, Ints]:
    data = rplidar.pack_dense(_starts(samples), samples.rows(samples.millimetres))
    return _equal(data, len(samples.sizes))


def _ultra_dense(samples: Samples) -> tuple[bytes, Ints]:
    stamp = (samples.times_ns[::64] * 1e-3).astype(np.int64)
    rows = samples.rows(samples.millimetres)
    data = rplidar.pack_ultra_dense(_starts(samples), rows, np.full(rows.shape, 200), time_us=stamp)
    return _equal(data, len(rows))


def _ldrobot(samples: Samples) -> tuple[bytes, Ints]:
    hundredths = samples.rows(np.floor(samples.turns * 36_000).astype(np.int64) % 36_000)
    times = samples.times_ns[::12]
    speed = np.gradient(samples.turns[::12], times) * 360e9
    data = ldrobot.pack_points(
        samples.rows(samples.millimetres),
        np.full(hundredths.shape, 200),
        hundredths[:, 0],
        hundredths[:, -1],
        speed=np.rint(speed).astype(np.int64),
        milliseconds=(times // 1_000_000 % 30_000).astype(np.int64),
    )
    return _equal(data, len(times))


def _ydlidar(layout: ydlidar.Layout, speed_base: int, samples: Samples) -> tuple[bytes, Ints]:
    q6, firsts = _q6(samples.turns), np.cumsum(samples.sizes) - samples.sizes
    zero, full = _begins(samples.turns), int(samples.sizes.max())
    packets = dict[int, bytes]()
    whole = np.flatnonzero(samples.sizes == full)
    grid = firsts[whole, None] + np.arange(full)
    data = ydlidar.pack_points(samples.millimetres[grid], q6[grid[:, 0]], q6[grid[:, -1]], layout=layout)
    for at, packet in enumerate(whole.tolist()):
        packets[packet] = data[at * len(data) // len(whole) : (at + 1) * len(data) // len(whole)]
    for packet in np.flatnonzero(samples.sizes != full).tolist():
        first = int(firsts[packet])
        last = first + int(samples.sizes[packet]) - 1
        control = 0
        if zero[first]:
            step = samples.turns[first] - samples.turns[first - 1]
            control = ydlidar.start_control(step * 1e9 / (samples.times_ns[1] - samples.times_ns[0]), speed_base)
        packets[packet] = ydlidar.pack_points(
            samples.millimetres[first : last + 1], q6[first], q6[last], control=control, layout=layout
        )
    parts = [packets[packet] for packet in range(len(samples.sizes))]
    return b"".join(parts), np.array([len(part) for part in parts])


def _express_shift(millimetres: Floats, place: Ints) -> Floats:
    del millimetres
    return -_EXPRESS_OFFSETS_Q3[place] / 8.0


def _ultra_shift(millimetres: Floats, place: Ints) -> Floats:
    """Of far samples; in whole steps, as the vendor's SDK 2.1.0 counts."""
    del place
    k = np.floor(98361.0 / (millimetres * 4.0))
    return np.degrees((k * 64.0 + np.floor(k**3 / 98304.0)) / 65536.0) - 8.0


def _triangle_shift(millimetres: Floats, place: Ints) -> Floats:
    """Of a lens 21.8 mm aside (the vendor's SDK)."""
    del place
    return np.degrees(np.arctan2(21.8 * (155.3 - millimetres), 155.3 * millimetres))


_PACKERS: dict[int, tuple[Callable[[Samples], tuple[bytes, Ints]], int, tuple[float, float, int]]] = {
    0x81: (_standard, 1, (0.25, 0.25, 65535)),
    0x82: (_express, 32, (1.0, 1.0, 16383)),
    0x83: (_hq, 96, (0.25, 0.25, 1 << 22)),
    # Far enough that all three samples of a cabin can be written, whatever the distances of its neighbours are.
    0x84: (_ultra, 96, (4096.0, 8.0, 510)),
    0x85: (_dense, 40, (1.0, 1.0, 65535)),
    0x86: (_ultra_dense, 64, (24572.0, 5.0, 8190)),
}
"""By response type: the packer, the samples of a packet, and the distances that can be written."""


def _rplidar(name: str, profile: Profile, mode: Mode, hertz: float = 10.0) -> Form:
    pack, samples, words = _PACKERS[mode.response_type]
    shift = {0x82: _express_shift, 0x84: _ultra_shift}.get(mode.response_type)
    kind = rplidar_kind(name, profile, mode)
    return Form(name, kind, profile.baudrate, hertz, samples, 1.0, pack_announcement(mode), words, pack, shift)


def _ydlidar_form(name: str, kind: Kind, profile: YdlidarProfile, speed_base: int, hertz: float) -> Form:
    # Quarters of a millimetre from two metres on: nearer, the lens turns the angle far.
    words = (2000.0, 0.25, 57_000) if profile.triangle else (1.0, 1.0, 65535)
    intro = ydlidar.pack_response(0x04, bytes((profile.model,)) + bytes(19)) + ydlidar.SCAN_HEADER
    shift = _triangle_shift if profile.triangle else None
    pack = partial(_ydlidar, profile.layout, speed_base)
    return Form(name, kind, profile.baudrate, hertz, 40, 0.5, intro, words, pack, shift)


def _sold(name: str, model: str, mode: int, hertz: float = 10.0) -> Form:
    profile = PROFILES[model]
    return _rplidar(name, profile, next(each for each in profile.modes if each.id == mode), hertz)


def _forms() -> Iterator[Form]:
    yield _sold("0x81 S1", "rplidar-s1", 0)
    yield _sold("0x82 A2", "rplidar-a2", 1)
    yield _sold("0x82 A1", "rplidar-a1", 1, 7.14)
    yield _sold("0x83 HQ", "rplidar-hq", 1)
    yield _sold("0x84 A3", "rplidar-a3", 3)
    yield _sold("0x84 A1", "rplidar-a1", 2, 7.14)
    yield _sold("0x85 S2", "rplidar-s2", 1)
    yield _sold("0x85 S1", "rplidar-s1", 1)
    yield _sold("0x85 C1", "rplidar-c1", 1)
    yield _sold("0x86", "rplidar-ultradense", 1)
    yield _ydlidar_form("4ROS", RATES["4ROS"].kind, YDLIDARS["ydlidar-4ros"], 30, 7.0)
    yield _ydlidar_form("X4", RELATIVES["X4 points"], YDLIDARS["ydlidar-x4"], 0, 7.6)
    triangulating = RELATIVES["X4 points"]
    # The rate that both sheets of the protocol know as its fastest.
    mode = replace(triangulating.mode, sample_us=1e6 / 9000)
    form = _ydlidar_form("G4", replace(triangulating, mode=mode), YDLIDARS["ydlidar-g4"], 0, 7.0)
    yield replace(form, rates=MODELS["g4"].rates)
    yield Form("LD19", RELATIVES["LD19 packets"], 230_400, 10.0, 12, 0.3, b"", (1.0, 1.0, 65535), _ldrobot)


FORMATS = {form.name: form for form in _forms()}
"""Every format, with small packets and with large ones."""
