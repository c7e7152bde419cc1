"""What a line of noise costs: CPU for a second of random bytes, beside a second of the undamaged stream.

As at a wrong baud rate or on a broken cable: behind the descriptor of a stream come as many bytes as it has, all of
them random. A parser that tries each byte by itself makes such a line cost many times what a clean one does, when
the program has other troubles already. In 0x81 every fourth pair of random bytes looks like the beginning of a
node; there twice is the bound.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.report import Result, Setting, Table, ratio, spread
from benchmarks.streams import KINDS, Kind, capture
from lidario.revolution.assemble import Assembler
from lidario.wire.envelope import DESCRIPTOR_SIZE
from lidario.wire.events import Packets
from lidario.wire.link import Link

__all__ = ["MOST", "cost_ms", "run"]

MOST = 2.0
"""How many times the cost of a clean line a line of noise may cost."""

_CHUNKS = (64, 512)
_SECONDS = 2.0


def run(setting: Setting) -> Result:
    """Clean and random bytes by turns, in every format and two sizes of chunks."""
    rounds = 1 if setting.quick else 7
    table = Table(
        "garbage: CPU for a second of the line, ms",
        ["format", "chunks of", "clean", "random", f"ratio; 0x81: at most {MOST:g}"],
    )
    data: dict[str, dict[str, list[float]]] = {}
    for name, kind in KINDS.items():
        setting.say(f"garbage: {name}")
        for chunk in _CHUNKS:
            took: dict[str, list[float]] = {"clean": [], "random": []}
            for number in range(rounds):
                for what, times in took.items():
                    times.append(cost_ms(kind, chunk, noise_seed=number if what == "random" else None))
            data[f"{name}, {chunk}"] = took
            table.rows.append(
                [
                    name,
                    f"{chunk} B",
                    spread(took["clean"], 2),
                    spread(took["random"], 2),
                    ratio(took["random"], took["clean"]),
                ]
            )
    return Result("garbage", [table], data)


def cost_ms(kind: Kind, chunk: int, noise_seed: int | None) -> float:
    """Milliseconds of CPU for a second of the line, in memory: parsed, assembled, decoded.

    Args:
        kind: The format.
        chunk: Bytes in each delivery.
        noise_seed: Seed of the random bytes; None for the stream itself.
    """
    whole = capture(kind, _SECONDS)
    raw = whole[DESCRIPTOR_SIZE:]
    if noise_seed is not None:
        raw = np.random.default_rng(noise_seed).bytes(len(raw))
    link, stream = Link(), kind.stream()
    link.send_request(kind.request(stream.format))
    link.receive_data(whole[:DESCRIPTOR_SIZE], 0)
    link.events_received()
    assembler, step_ns = Assembler(stream), _SECONDS * 1e9 / len(raw)
    began = time.process_time()
    for at in range(0, len(raw), chunk):
        link.receive_data(raw[at : at + chunk], round((at + chunk) * step_ns))
        for event in link.events_received():
            if isinstance(event, Packets):
                assembler.add(event)
    return (time.process_time() - began) * 1e3 / _SECONDS
