"""Hokuyo URG-04LX, UST-10LX, UST-20LX and UTM-30LX: SCIP 2.0 over serial ports, USB and TCP.

Sources throughout: the SCIP 2.0 specification, urg_library 1.2.7 and hokuyolx 0.9.0. Nothing was tried on a device.
"""

from typing import Final

from lidario.families.base import Family, Timing
from lidario.families.hokuyo.device import FORMATS, HokuyoDevice, find_stream, stream_in

FAMILY: Final = Family(
    name="hokuyo",
    title="Hokuyo",
    # By USB and TCP any speed will do. A serial port begins at 19200, which would cost every
    # search for other devices; ``?baud=19200`` names it.
    baudrates=(115_200,),
    timing=Timing(
        # A scan comes every 100 ms at most.
        quiet_s=0.12,
        drain_s=1.0,
        # In no document: RS sets everything back and is answered at once.
        boot_s=3.0,
        forget_s=0.5,
    ),
    device=HokuyoDevice,
    formats=FORMATS,
    find_stream=find_stream,
    stream_in=stream_in,
)
