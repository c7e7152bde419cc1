"""YDLIDAR: the 4ROS and its relatives, see `models`.

Sources throughout: the 4ROS development manual, the 4ROS data sheet, and the vendor's C++ SDK 1.2.20 (1.2.19
where said). Nothing was measured on a real device.
"""

from functools import partial
from typing import Final

from lidario.families.base import Family, NamedModel, Timing
from lidario.families.ydlidar.device import BY_DTR_S, YdlidarDevice
from lidario.families.ydlidar.formats import FORMATS
from lidario.families.ydlidar.models import MODELS
from lidario.families.ydlidar.raw import find_stream, stream_in

FAMILY: Final = Family(
    name="ydlidar",
    title="YDLIDAR",
    # 4ROS (data sheet, chart 5), G6; G1 to G5, R2, Tmini; X4; X2, X3, S2, S4, F4, TX8; S4B.
    baudrates=(512_000, 230_400, 128_000, 115_200, 153_600),
    timing=Timing(
        # Packets come every 2 ms, and a USB adapter may hold bytes back for 16 ms.
        quiet_s=0.05,
        # No document says how long a restart takes, or how soon the device responds. The SDK waits up to 1 s for
        # device information.
        boot_s=5.0,
        # Requests are two bytes long, so the next one completes a half-written one.
        forget_s=0.5,
    ),
    device=YdlidarDevice,
    formats=FORMATS,
    find_stream=find_stream,
    stream_in=stream_in,
    models={name: NamedModel((model.baudrate,), partial(YdlidarDevice, model)) for name, model in MODELS.items()},
    # The most sold of those that respond, the only one at 153600 baud, and the most sold of those that only talk.
    # That one is last, since its motor must turn before it talks. The S4 must be named.
    by_dtr={"x4": 0.15, "s4b": 0.15, "x2": BY_DTR_S},
)
