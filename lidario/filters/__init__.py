"""Filters of scans: what a robot does not want to see of what its lidar sees.

::

    body = BoxFilter(-0.3, 0.2, -0.2, 0.2, mount=Mount(x=0.15))
    async for scan in lidar.scans(filters=[body, ShadowsFilter(), RadiusOutlierFilter()]):
        print(scan.nearest())

A filter is anything that is called with a `lidario.Scan` and returns one. Those here take a `lidario.Sector` too,
and return one. Each is a frozen record: it can be compared, pickled and shared. Names and rules are those of
``laser_filters`` of ROS, as far as they fit; angles are radians, ranges metres.

**What is filtered stays in its place**, as a sample without a return that `Scan.left_out` tells from the others. So
times, gaps, the grid of `Scan.to_laserscan` and the number of samples do not change. `Scan.points`, `Scan.nearest`
and `Scan.xy` see no return there. In a LaserScan it is NaN, or ``filtered="inf"``.
``scan.select(~scan.left_out)`` is the scan without these samples.

**The order** of `AngularBoundsFilter`, `RangeFilter`, `IntensityFilter`, `BoxFilter` and `PolygonFilter` does not
matter: each looks at one sample at a time. `ShadowsFilter`, `RadiusOutlierFilter` and `MedianFilter` look at
neighbours, and see what the filters before them have left.
"""

from __future__ import annotations

from lidario.filters.areas import BoxFilter, PolygonFilter
from lidario.filters.base import Filter, MaskFilter
from lidario.filters.neighbors import MedianFilter, RadiusOutlierFilter, ShadowsFilter
from lidario.filters.single import AngularBoundsFilter, IntensityFilter, RangeFilter

__all__ = [
    "AngularBoundsFilter",
    "BoxFilter",
    "Filter",
    "IntensityFilter",
    "MaskFilter",
    "MedianFilter",
    "PolygonFilter",
    "RadiusOutlierFilter",
    "RangeFilter",
    "ShadowsFilter",
]
