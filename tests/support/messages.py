"""LaserScan messages as others read them: of a file by ``mcap``, their bytes by ``rosbags``."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

_STORE = get_typestore(Stores.ROS2_JAZZY)


def decoded(data: bytes, kind: str = "sensor_msgs/msg/LaserScan") -> Any:
    """One message."""
    return _STORE.deserialize_cdr(data, kind)


def scans_of_file(path: Path) -> list[Any]:
    """All messages of the topic /scan, in the order of the file."""
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=["/scan"], log_time_order=False)
        return [decoded(message.data) for _, _, message in messages]
