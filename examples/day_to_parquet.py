"""Recordings as Parquet, a row for each scan, as many files at once as there are cores.

pip install pyarrow dask
python day_to_parquet.py FOLDER INTO
"""

import sys
from itertools import islice
from pathlib import Path

import dask.bag
import pyarrow.parquet

import lidario

NUMBERS = pyarrow.list_(pyarrow.float32())
COLUMNS = {"stamp_ns": pyarrow.int64(), "rpm": pyarrow.float64(), "angles": NUMBERS, "ranges": NUMBERS}


def convert(path: Path, into: Path) -> int:
    """Write the scans of one recording: stamps since the Unix epoch, radians, metres; returns how many."""
    count, scans, schema = 0, lidario.decode_file(path), pyarrow.schema(COLUMNS)
    with pyarrow.parquet.ParquetWriter(into / f"{path.stem}.parquet", schema) as file:
        while rows := [(scan.wall_stamp_ns, scan.rpm, scan.angles, scan.ranges) for scan in islice(scans, 600)]:
            file.write_table(pyarrow.table(dict(zip(COLUMNS, zip(*rows, strict=True), strict=True)), schema))
            count += len(rows)
    return count


def main(folder: Path, into: Path) -> None:
    """Convert all recordings of a folder."""
    into.mkdir(exist_ok=True)
    paths = sorted(folder.glob("*.mcap"))
    counts = dask.bag.from_sequence(paths, partition_size=1).map(convert, into).compute(scheduler="processes")
    print(f"{sum(counts)} scans of {len(paths)} recordings")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:])) if len(sys.argv) == 3 else sys.exit(__doc__)
