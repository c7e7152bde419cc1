"""The plots: cost against the size of the chunks, and against the number of lidars."""

from __future__ import annotations

import json
import statistics
import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams["svg.hashsalt"] = "lidario"  # the same figures make the same file

import matplotlib.pyplot as plt  # noqa: E402 - only after the backend is chosen


def _middle(rounds: list[dict[str, float]], key: str) -> float:
    return statistics.median(each[key] for each in rounds)


def _finish(figure: Any, folder: Path, name: str) -> None:
    path = folder / f"{name}.svg"
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    print(path.name)


def chunks(data: dict[str, Any], folder: Path) -> None:
    """Microseconds a revolution against bytes a chunk, a line for each format."""
    figure, axes = plt.subplots(figsize=(7, 4.2))
    sizes = [size for size in data["chunks"] if size != "whole"]
    places = [int(size) for size in sizes]
    for name, by_chunk in data["lidario"].items():
        cost = [_middle(by_chunk[size], "us_per_revolution") for size in sizes]
        (line,) = axes.plot(places, cost, marker="o", markersize=3, label=name)
        whole = _middle(by_chunk["whole"], "us_per_revolution")
        axes.plot([65536], [whole], marker="s", markersize=4, color=line.get_color())
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks([*places, 65536], [*sizes, "whole"])
    axes.set_xlabel("bytes a chunk")
    axes.set_ylabel("µs a revolution")
    axes.set_title("Decoding in memory: cost against the size of the chunks")
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize=8)
    _finish(figure, folder, "chunks")


def lidars(data: dict[str, Any], folder: Path) -> None:
    """CPU and latency against the number of lidars, a line for each latency setting."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8))
    by_latency: dict[float, list[tuple[int, float, float]]] = {}
    for rounds in data["counts"].values():
        late = sorted(each for one in rounds for each in one["late_ms"])
        worst = late[min(len(late) - 1, round(0.99 * len(late)))] if late else float("nan")
        first = rounds[0]
        point = (first["lidars"], 100 * _middle(rounds, "cpu"), worst)
        by_latency.setdefault(first["latency_s"], []).append(point)
    for latency, points in sorted(by_latency.items()):
        count, cpu, p99 = zip(*sorted(points), strict=True)
        left.plot(count, cpu, marker="o", label=f"latency {latency * 1000:g} ms")
        right.plot(count, p99, marker="o", label=f"latency {latency * 1000:g} ms")
    right.set_xscale("log", base=2)
    for axes, what in ((left, "CPU, % of a core"), (right, "p99 of the delay of a scan, ms")):
        # On the even scale of the left picture, 1 and 4 would stand on each other.
        axes.set_xticks(count, [str(each) if axes is right or each >= 16 else "" for each in count])
        axes.set_xlabel("S2 lidars at 32 kS/s in one process")
        axes.set_ylabel(what)
        axes.set_ylim(bottom=0)
        axes.grid(True, alpha=0.3)
        axes.legend(fontsize=8)
    _finish(figure, folder, "lidars")


def live(data: dict[str, Any], folder: Path) -> None:
    """CPU of everybody who reads live, a panel for each device."""
    rates = data["rates"]
    heights = [len(each) for each in rates.values()]
    figure, panels = plt.subplots(
        len(rates), 1, figsize=(7.5, 0.32 * sum(heights) + 2.2), height_ratios=heights, sharex=True
    )
    for axes, (rate, found) in zip(panels, rates.items(), strict=True):
        names = list(reversed(found))
        cpu = [100 * _middle(found[name], "cpu") for name in names]
        colours = ["tab:blue" if name.startswith("lidario") else "tab:gray" for name in names]
        bars = axes.barh(names, cpu, color=colours)
        axes.bar_label(bars, fmt="%.2f", fontsize=7, padding=2)
        axes.margins(x=0.1)
        axes.set_title(rate, fontsize=9)
        axes.tick_params(labelsize=8)
    panels[-1].set_xlabel("CPU of the reading process, % of a core")
    _finish(figure, folder, "live")


def blocked(data: dict[str, Any], folder: Path) -> None:
    """Bytes lost against the length of the block, a panel for each kind of block, a line for each reader."""
    found = data["found"]
    kinds = list(dict.fromkeys(each["kind"] for each in found))
    figure, panels = plt.subplots(1, len(kinds), figsize=(10, 3.6), sharey=True, squeeze=False)
    for axes, kind in zip(panels[0], kinds, strict=True):
        lines: dict[tuple[str, str], list[tuple[int, float]]] = {}
        for each in found:
            if each["kind"] == kind:
                point = (each["block_ms"], 100 * each["lost_share"])
                lines.setdefault((each["device"], each["reader"]), []).append(point)
        colours: dict[str, str] = {}
        for (device, reader), points in lines.items():
            colour = colours.setdefault(device, f"C{len(colours)}")
            ours = reader == "lidario"
            style = {"linestyle": "-", "marker": "o"} if ours else {"linestyle": ":", "marker": "x"}
            axes.plot(*zip(*points, strict=True), color=colour, markersize=4, label=f"{reader}, {device}", **style)
        axes.set_xscale("log")
        ticks = sorted({each["block_ms"] for each in found})
        axes.set_xticks(ticks, [str(each) for each in ticks], fontsize=8)
        axes.minorticks_off()
        axes.set_title(f"blocked by: {kind}", fontsize=9)
        axes.set_xlabel("length of a block, ms")
        axes.grid(True, alpha=0.3)
    # Only now: it would fix the scale that all share.
    panels[0][0].set_ylim(-2, 100)
    panels[0][0].set_ylabel("bytes lost, % of all")
    panels[0][0].legend(fontsize=7, loc="upper left")
    _finish(figure, folder, "blocked")


def main(results: Path, folder: Path) -> None:
    found = json.loads(results.read_text())["benchmarks"]
    for name, plot in (("decode", chunks), ("scale", lidars), ("live", live), ("blocked", blocked)):
        if name in found:
            plot(found[name], folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
