"""An occupancy grid: what is free and what is not, in cells of 0.1 m around a lidar that stands still.

python occupancy_grid.py [SOURCE]
"""

import sys

import numpy as np
from numpy.typing import NDArray

import lidario

CELL_M = 0.1
SIZE = 96  # cells on each side: 9.6 m
HIT, PASSED = 0.9, -0.4  # how much a return, and a beam that passes through, say (log odds)


class Grid:
    """Evidence for each cell: positive where something is, negative where beams passed."""

    def __init__(self) -> None:
        self.cells: NDArray[np.float32] = np.zeros((SIZE, SIZE), np.float32)

    def add(self, scan: lidario.Scan) -> None:
        """Add the evidence of one scan."""
        self.see(scan.xy()[scan.valid])

    def see(self, xy: NDArray[np.floating], origin: tuple[float, float] = (0.0, 0.0)) -> None:
        """Add the evidence of returns that were seen from there."""
        beams = xy - np.array(origin)
        # Along each beam a point every half cell, but not in the cell of the return itself.
        along = np.arange(0.0, np.linalg.norm(beams, axis=1).max(initial=0.0), CELL_M / 2)
        lengths = np.linalg.norm(beams, axis=1, keepdims=True)
        shares = np.where(along < lengths - CELL_M, along / lengths, np.nan)
        passed = (origin + beams[:, None, :] * shares[:, :, None]).reshape(-1, 2)
        self._count(passed[np.isfinite(passed[:, 0])], PASSED)
        self._count(xy, HIT)
        np.clip(self.cells, -8.0, 8.0, out=self.cells)

    def _count(self, xy: NDArray[np.floating], evidence: float) -> None:
        index = np.floor(xy / CELL_M).astype(int) + SIZE // 2
        inside = ((index >= 0) & (index < SIZE)).all(axis=1)
        # One number for each cell: to sort pairs takes ten times as long, and holds up the scans.
        touched = np.unique(index[inside] @ (SIZE, 1))
        self.cells.reshape(-1)[touched] += evidence

    def __str__(self) -> str:
        pairs = self.cells.reshape(-1, 2, SIZE).max(axis=1)  # a letter is twice as high as wide
        marks = np.where(pairs > 0, "#", np.where(pairs < 0, ".", " "))
        return "\n".join("".join(row) for row in marks[::-1, ::-1])  # forward is up, left is left


async def main(source: str | lidario.SimulatedDevice = "auto", count: int = 10) -> Grid:
    """Add some scans and print the grid."""
    grid = Grid()
    async with lidario.open_lidar(source) as lidar, lidar.scans() as scans:
        async for scan in scans:  # a recording may end before
            grid.add(scan)
            count -= 1
            if not count:
                break
    print(grid)
    return grid


if __name__ == "__main__":
    lidario.run(main(sys.argv[1] if len(sys.argv) > 1 else "auto"))
