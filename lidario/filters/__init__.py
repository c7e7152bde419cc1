"""Filters of scans: what a robot does not want to see of what its lidar sees.

::

    body = BoxFilter(-0.3, 0.2, -0.2, 0.2, mount=Mount(x=0.15))
    async for scan in lidar.scans(filters=[body, ShadowsFilter(), RadiusOutlierFilter()]):
        print(scan.nearest())

A filter is anything that is called with a `lidario.Scan` and returns one; those here take a `lidario.Sector` too.
Each is a frozen record. What is filtered stays in its place, as a sample without a return that `Scan.left_out`
tells from the others. docs/filters.md tells the rules, and which order matters.
"""

from lidario.filters.areas import BoxFilter, PolygonFilter
from lidario.filters.base import Filter, MaskFilter
from lidario.filters.neighbors import MedianFilter, RadiusOutlierFilter, ShadowsFilter
from lidario.filters.single import AngularBoundsFilter, IntensityFilter, RangeFilter

__all__ = [
    "AngularBoundsFilter", "BoxFilter", "Filter", "IntensityFilter", "MaskFilter", "MedianFilter",
    "PolygonFilter", "RadiusOutlierFilter", "RangeFilter", "ShadowsFilter",
]  # fmt: skip
