"""The benchmarks run: every format is decoded and delivered, and what was found can be printed and kept.

No figure is looked at: a shared machine has none to rely on.
"""

import json
import re
from pathlib import Path

import pytest

import lidario
from benchmarks import damage, decode, export, garbage, reaction, stages, vendor, view
from benchmarks.models import FORMATS
from benchmarks.report import Setting
from benchmarks.streams import KINDS, capture
from lidario.families.rplidar.simulated.device import make_simulated
from lidario.revolution.pipeline import Pipeline
from lidario.wire.blocks import packet_offsets
from lidario.wire.envelope import DESCRIPTOR_SIZE


@pytest.mark.long
def test_every_format_is_decoded_in_every_size_of_chunks() -> None:
    decoded = decode.run(Setting(quick=True))
    found = json.loads(json.dumps(decoded.data))
    assert set(found["lidario"]) == set(KINDS)
    assert len(KINDS) == 7
    for name, by_chunk in found["lidario"].items():
        assert list(by_chunk) == ["1", "16", "64", "1024", "4096", "whole", "file", decode.CONVERTED]
        for chunk, rounds in by_chunk.items():
            assert rounds[0]["scans"] >= 3, f"{name} in chunks of {chunk}"
        # The size of the chunks does not change what is delivered.
        longer = ("64", "1024", "4096", "whole", decode.CONVERTED)
        assert len({by_chunk[chunk][0]["samples"] for chunk in longer}) == 1
    assert set(found["relatives"]) == set(FORMATS)
    for name, by_chunk in found["relatives"].items():
        for chunk in ("4096", "file"):
            got = by_chunk[chunk][0]
            assert got["scans"] >= 10, f"{name}, {chunk}"
            # A whole revolution: of 4000 samples a second at seven turns there are 571, at whole degrees 360.
            assert 350 < got["samples"] / got["scans"] < 3000
    for table, rows in zip(decoded.tables, (3 * len(KINDS), len(KINDS), len(FORMATS)), strict=True):
        lines = [line for line in table.markdown().splitlines() if line.startswith("|")]
        assert len(lines) == 2 + rows
        assert len({line.count("|") for line in lines}) == 1


@pytest.mark.long
def test_the_stages_of_a_turn_are_told_for_every_format() -> None:
    result = stages.run(Setting(quick=True))
    in_memory, live, session = result.tables
    assert [row[0] for row in in_memory.rows] == list(KINDS)
    for row in in_memory.rows:
        assert len(row) == len(in_memory.columns) == 2 + 2 * len(stages.STAGES)
    # The decoder's part is measured, not what is left over.
    assert all(min(each["decoder"]) > 0 for each in result.data["formats"].values())
    assert len(live.rows) == 4
    assert all(len(took) == 3 and min(took) > 0 for took in result.data["live"].values())
    for _, calls, _ in session.rows:
        assert re.fullmatch(r"\d+ calls of \d+ functions in \d+ files", calls)
    assert [len(each["us"]) for each in result.data["deliveries"].values()] == [3, 3]


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, []),
        ({"info": None}, ["model None", "firmware_version None", "hardware_version None", "serial_number None"]),
        ({"health": [2, 1]}, ["health [2, 1]"]),
        ({"started": False}, ["scan not started"]),
        ({"scans": []}, ["no scan"]),
        ({"scans": [[3200, 2.0], [1600, 2.0]]}, ["1600 samples instead of 3200"]),
        ({"scans": [[3200, 2.5]]}, ["2.5 m instead of 2.0 m"]),
    ],
)
def test_what_the_vendors_driver_read_is_compared(changes: dict[str, object], wrong: list[str]) -> None:
    device = make_simulated("rplidar-s2")
    device.receive(bytes.fromhex("a5820501000000 0023"), 0)
    info = {"model": 0x71, "firmware_version": 0x102, "hardware_version": 18, "serial_number": device.serial.hex()}
    told = {"info": info, "health": [0, 0], "started": True, "scans": [[700, 1.0], [3210, 2.0]]}
    of = vendor.Run(device, told | changes)
    assert of.mode == "DenseBoost"
    assert of.wrong() == wrong
    assert vendor.Run(device, {}, "it crashed").wrong() == ["it crashed"]


@pytest.mark.long
async def test_viewers_of_the_page_leave_no_memory_behind() -> None:
    # 300 scans are 3800 kB, and two viewers may hold two each.
    assert await view.grown(300) < 1000


def test_the_table_of_the_page_is_markdown() -> None:
    stalled = {
        name + what: 1.0 for name in ("alone", "beside three that stopped reading") for what in ("", ", CPU")
    }
    data = {
        "page_bytes": 1, "cpu": {"viewers: 0": [1.0], "viewers: 1": [1.5]}, "paint_ms": [], "arrival_ms": [1.0],
        "stalled": stalled, "growth_kb": 4.0,
    }  # fmt: skip
    lines = [line for line in view.table_of(data).markdown().splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    assert any("+0.50 %" in line for line in lines)
    assert any("not run: no Chromium" in line for line in lines)


@pytest.mark.long
def test_a_long_recording_is_made_of_a_short_one(tmp_path: Path) -> None:
    export.make_recording(tmp_path / "a.mcap", 20.0)
    found = lidario.summarize(tmp_path / "a.mcap")
    assert found.scans == pytest.approx(200, abs=3)
    assert found.duration_s == pytest.approx(20.0, abs=0.3)
    # Where one copy ends and the next begins, the rotor stands a few packets elsewhere.
    assert found.lost_packets <= 8
    assert (found.missed_scans, found.skipped_bytes) == (0, 0)


@pytest.mark.long
@pytest.mark.parametrize("name", [*damage.DAMAGES, *damage.SCARCE])
def test_the_page_of_damage_shows_what_its_command_prints(name: str) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text(encoding="utf-8")
    told = re.search(rf"^#+ {name}\n\n((?:\|.*\n)+)", page, re.MULTILINE | re.IGNORECASE)
    (table,) = damage.run(Setting(quick=False, words=(name,))).tables
    assert told is not None
    assert told[1].splitlines() == table.markdown().splitlines()[2:]


@pytest.mark.long
def test_obstacles_are_shown_to_a_reader_of_scans_and_to_one_of_sectors() -> None:
    # Of a machine that starves it the device loses bytes, and behind that notes nothing: then once more.
    for _ in range(6):
        (table,) = reaction.run(Setting(quick=True)).tables
        assert [row[0] for row in table.rows] == ["10 Hz, scans", "10 Hz, sectors"]
        if all(int(row[4]) > 0 for row in table.rows):
            return
    raise AssertionError(table.markdown())


@pytest.mark.long
def test_noise_is_compared_with_a_clean_line_of_every_format() -> None:
    (table,) = garbage.run(Setting(quick=True)).tables
    assert [row[0] for row in table.rows[::2]] == list(KINDS)
    assert all(float(cell) > 0 for row in table.rows for cell in row[2:])


@pytest.mark.parametrize("number", [0, 1, 3])
def test_a_damaged_start_packet_is_told_also_the_first(number: int) -> None:
    kind = KINDS["4ROS points"]
    raw = bytearray(capture(kind, 1.5)[DESCRIPTOR_SIZE:])
    wire, end = kind.make_format(), 0
    starts: list[int] = []
    while (stretch := wire.next_stretch(raw, end)).end > end:
        offsets = [end + at for at in packet_offsets(stretch.packets)]
        starts += [at for at in offsets[:-1] if raw[at + 2] & 1]
        end = stretch.end
    raw[starts[number] + 8] ^= 1
    pipeline, scans = Pipeline(kind.stream()), 0
    for at in range(0, len(raw), 512):
        scans += len(pipeline.receive(raw[at : at + 512], round(at * 1.5e9 / len(raw))))
    assert scans > 5
    assert pipeline.stats.lost_packets == 1
