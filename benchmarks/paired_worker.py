"""Decodes for `benchmarks.paired`, with the code of whichever checkout is first in the path.

It is run by its path, with another checkout as its working directory, so it must work with code of other times: it
takes `Link`, `Assembler` and `Packets` from wherever that checkout's own `benchmarks.decode` has them.

Each line that it reads is a task in JSON: ``kind``, a name of `KINDS`; ``path``, a file with the stream of such a
device; ``chunk``, bytes at a time, 0 for all at once; ``seconds``, the time that the stream took; ``passes``. It
answers with a line each: the seconds of CPU time of each pass, and how many scans there were in one.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from benchmarks import decode
from benchmarks.streams import KINDS

__all__: list[str] = []

_Link, _Assembler, _Packets = (vars(decode)[name] for name in ("Link", "Assembler", "Packets"))


def timed(kind: str, path: str, chunk: int, seconds: float, passes: int) -> dict[str, object]:
    """Decode a stream several times."""
    raw, made_of = Path(path).read_bytes(), KINDS[kind]
    step = chunk or len(raw)
    byte_ns = seconds * 1e9 / len(raw)
    took, scans = list[float](), 0
    for _ in range(passes):
        stream, link = made_of.stream(), _Link()
        link.send_request(made_of.request(stream.format))
        link.data_to_send()
        assembler, scans = _Assembler(stream), 0
        begin = time.process_time()
        for at in range(0, len(raw), step):
            link.receive_data(raw[at : at + step], int((at + step) * byte_ns))
            for event in link.events_received():
                if isinstance(event, _Packets):
                    scans += len(assembler.add(event))
        took.append(time.process_time() - begin)
    return {"seconds": took, "scans": scans}


if __name__ == "__main__":
    if not Path(str(decode.__file__)).is_relative_to(Path.cwd()):
        # Python found those of an installed lidario.
        sys.exit("it has no benchmarks")
    for line in sys.stdin:
        print(json.dumps(timed(**json.loads(line))), flush=True)
