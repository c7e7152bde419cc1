"""Decodes for `benchmarks.paired`, with the code of whichever checkout is first in the path.

It is run by its path, with another checkout as its working directory, so it must work with code of other times: it
takes what has stood in the same place since 0265bcb.

Each line that it reads is a task in JSON: ``kind``, a name of `KINDS`; ``path``, a file with the stream of such a
device; ``chunk``, bytes at a time, 0 for a whole file; ``seconds``, the time that the stream took; ``passes``. It
answers with a line each: the seconds of CPU time of each pass, and how many scans there were in one.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from pathlib import Path

import lidario
from benchmarks import streams
from lidario.revolution.assemble import Assembler
from lidario.wire.events import Packets
from lidario.wire.link import Link


def timed(kind: str, path: str, chunk: int, seconds: float, passes: int) -> dict[str, object]:
    """Decode a stream several times."""
    raw, made_of = Path(path).read_bytes(), streams.KINDS[kind]
    if not chunk:
        return _of_file(path, made_of.family, passes)
    byte_ns = seconds * 1e9 / len(raw)
    took, scans = list[float](), 0
    for _ in range(passes):
        stream, link = made_of.stream(), Link()
        link.send_request(made_of.request(stream.format))
        assembler, scans = Assembler(stream), 0
        begin = time.process_time()
        for at in range(0, len(raw), chunk):
            link.receive_data(raw[at : at + chunk], int((at + chunk) * byte_ns))
            for event in link.events_received():
                if isinstance(event, Packets):
                    scans += len(assembler.add(event))
        took.append(time.process_time() - begin)
    return {"seconds": took, "scans": scans}


def _of_file(path: str, family: str, passes: int) -> dict[str, object]:
    took, scans = list[float](), 0
    for _ in range(passes):
        begin = time.process_time()
        scans = sum(1 for _ in lidario.decode_file(path, family=family))
        took.append(time.process_time() - begin)
    return {"seconds": took, "scans": scans}


if __name__ == "__main__":
    if not Path(str(streams.__file__)).is_relative_to(Path.cwd()):
        # Python found those of an installed lidario.
        sys.exit("it has no benchmarks")
    logging.disable()  # which model it is may be a guess
    for line in sys.stdin:
        print(json.dumps(timed(**json.loads(line))), flush=True)
