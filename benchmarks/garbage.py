"""What a line of noise costs: CPU for a second of noise, beside a second of the undamaged stream.

As at a wrong baud rate or on a broken cable: behind the descriptor of a stream come as many bytes as it has, all of
them random; or by turns fifty bytes of the stream and fifty random ones, so that much looks like packets. A parser
that tries each byte by itself makes such a line cost many times what a clean one does, when the program has other
troubles already. In 0x81 every fourth pair of random bytes looks like the beginning of a node; there twice is the
bound.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.report import Result, Setting, Table, ratio, spread
from benchmarks.streams import KINDS, Kind, capture
from lidario.revolution.pipeline import Pipeline
from lidario.wire.envelope import DESCRIPTOR_SIZE

MOST = 2.0
"""How many times the cost of a clean line a line of noise may cost."""

_CHUNKS = (64, 512)
_PART = 50


def run(setting: Setting) -> Result:
    """Clean and random bytes by turns, in every format and two sizes of chunks."""
    rounds, seconds = (1, 0.6) if setting.quick else (7, 2.0)
    table = Table(
        "garbage: CPU for a second of the line, ms",
        ["format", "chunks of", "clean", "random", "ratio", "half random", f"ratio; 0x81: at most {MOST:g}"],
    )
    data: dict[str, dict[str, list[float]]] = {}
    for name, kind in KINDS.items():
        setting.say(f"garbage: {name}")
        for chunk in _CHUNKS:
            took: dict[str, list[float]] = {"clean": [], "random": [], "half random": []}
            for number in range(rounds):
                for what, times in took.items():
                    times.append(cost_ms(kind, chunk, what, seed=number, seconds=seconds))
            data[f"{name}, {chunk}"] = took
            table.add(
                name,
                f"{chunk} B",
                spread(took["clean"], 2),
                spread(took["random"], 2),
                ratio(took["random"], took["clean"]),
                spread(took["half random"], 2),
                ratio(took["half random"], took["clean"]),
            )
    return Result("garbage", [table], data)


def cost_ms(kind: Kind, chunk: int, what: str = "clean", seed: int = 0, seconds: float = 2.0) -> float:
    """Milliseconds of CPU for a second of the line, in memory: parsed, assembled, decoded.

    Args:
        kind: The format.
        chunk: Bytes in each delivery.
        what: "clean", "random" or "half random".
        seed: Of the random bytes.
        seconds: How long the line is.
    """
    whole = capture(kind, seconds)
    raw = whole[DESCRIPTOR_SIZE:]
    if what != "clean":
        random = np.random.default_rng(seed)
        part = _PART if what == "half random" else 0
        raw = b"".join(raw[at : at + part] + random.bytes(2 * _PART - part) for at in range(0, len(raw), 2 * _PART))
    pipeline, step_ns = Pipeline(kind.stream()), seconds * 1e9 / len(raw)
    began = time.process_time()
    for at in range(0, len(raw), chunk):
        pipeline.receive(raw[at : at + chunk], round((at + chunk) * step_ns))
    return (time.process_time() - began) * 1e3 / seconds
