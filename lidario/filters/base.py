"""What filters have in common: they are called with a scan or a sector, and return one."""

from abc import ABC, abstractmethod
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import shown
from lidario.errors import InvalidValue
from lidario.scans.measured import MeasuredSamples, with_distances
from lidario.scans.samples import FloatArray

RecordT = TypeVar("RecordT", bound=MeasuredSamples)


class Filter(ABC):
    """Base of the filters: called with a scan or a sector, each returns one."""

    __slots__ = ()

    @abstractmethod
    def __call__(self, record: RecordT, /) -> RecordT:
        """The same samples, behind the filter."""


class MaskFilter(Filter):
    """Base of the filters that take samples out, and change nothing else.

    For a filter of your own, write `leaves_out`.
    """

    __slots__ = ()

    @abstractmethod
    def leaves_out(self, record: MeasuredSamples, /) -> NDArray[np.bool_]:
        """Which samples it takes out, bool, shape (n,); the filter raises `InvalidValue` for another mask."""

    def __call__(self, record: RecordT, /) -> RecordT:
        """The same samples; those that it takes out have no return, and are `left_out`."""
        return with_distances(record, self._change)

    def _change(self, record: MeasuredSamples) -> tuple[FloatArray, NDArray[np.bool_] | None]:
        out, before = self.leaves_out(record), record._left_out  # noqa: SLF001 - of our own
        # Whole numbers would be taken for places of samples, and others would go than those that are meant.
        if not isinstance(out, np.ndarray) or out.dtype != np.bool_ or out.shape != (len(record),):
            raise InvalidValue(
                f"leaves_out() returns bool, one value a sample, shape ({len(record)},), not {shown(out)}"
            )
        if not out.any():
            return record.device_distances, before
        distances = record.device_distances.copy()
        distances[out] = 0
        # A copy: the mask may be one that the filter uses again.
        return distances, out.copy() if before is None else out | before
