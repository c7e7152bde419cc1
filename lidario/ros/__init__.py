"""ROS 2 without ROS, and fleets: messages as bytes, and publishers that need nothing but Python.

::

    async with lidario.open_lidar() as lidar, lidario.ros.Publisher(lidar, topic="scan") as publisher:
        await publisher.run()

The names are loaded when they are first used. Messages need numpy alone; everything that goes over the network
needs the extra ``zenoh``. docs/ros2.md and docs/fleets.md tell how to use them.
"""

from typing import TYPE_CHECKING

from lidario.loading import keep

if TYPE_CHECKING:
    from lidario.network.fleet import RemoteLidar, list_remote_lidars
    from lidario.network.router import Router
    from lidario.ros.diagnostics import DiagnosticArray, DiagnosticStatus, diagnostics
    from lidario.ros.fleet import Fleet, FleetScan
    from lidario.ros.merged import MergedPublisher
    from lidario.ros.pointcloud import PointCloud2, pointcloud2
    from lidario.ros.publisher import Publisher
    from lidario.ros.share import Share
    from lidario.scans.laserscan import LaserScan

__all__ = [
    "DiagnosticArray", "DiagnosticStatus", "Fleet", "FleetScan", "LaserScan", "MergedPublisher", "PointCloud2",
    "Publisher", "RemoteLidar", "Router", "Share", "diagnostics", "list_remote_lidars", "pointcloud2",
]  # fmt: skip

_HOMES = {
    "scans.laserscan": ("LaserScan",),
    "network.router": ("Router",),
    "network.fleet": ("RemoteLidar", "list_remote_lidars"),
    "ros.diagnostics": ("DiagnosticArray", "DiagnosticStatus", "diagnostics"),
    "ros.fleet": ("Fleet", "FleetScan"),
    "ros.merged": ("MergedPublisher",),
    "ros.pointcloud": ("PointCloud2", "pointcloud2"),
    "ros.publisher": ("Publisher",),
    "ros.share": ("Share",),
}


def __getattr__(name: str) -> object:
    return keep(__name__, name, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
