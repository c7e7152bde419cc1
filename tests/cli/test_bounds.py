"""No verb waits for ever: the table of verbs in ``docs/bounds.md``, in driven time."""

import re
from pathlib import Path

import pytest
from click.testing import Result

from lidario.cli.output import Worker
from tests.cli.processes import call_at_once, in_memory, invoke
from tests.support.children import ROOT
from tests.support.loop import DrivenLoop

TEXT = (ROOT / "docs" / "bounds.md").read_text(encoding="utf-8")
VERBS = re.findall(r"^\| `lidario ([^`]+)` \| ([\d.]+) \| ([\d.]+) \|", TEXT, re.MULTILINE)
MODELS = ("rplidar-s2", "ydlidar-4ros")
HARM = ("silent:0s", "silent:1s", "babble:2000", "garbage")

pytestmark = pytest.mark.discards("noise on the line, and devices that do not respond, are asked again and again")


def invoked(words: list[str]) -> tuple[Result, float]:
    """Run the command on a driven clock; also tells how many seconds of it have passed."""
    loops: list[tuple[DrivenLoop, float]] = []

    def make() -> DrivenLoop:
        loop = DrivenLoop()
        loops.append((loop, loop.time()))
        return loop

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("asyncio.events.new_event_loop", make)
        patch.setattr(Worker, "call", call_at_once)
        ended = invoke(*words)
    return ended, sum(loop.time() - began for loop, began in loops)


def test_the_table_has_the_verbs_that_ask_a_device() -> None:
    assert {words.split()[0] for words, _, _ in VERBS} == {
        "info", "scan", "plot", "stats", "doctor", "motor", "record"
    }  # fmt: skip


@pytest.mark.exhaustive("number", sample=[0], full=[0, 1])
@pytest.mark.parametrize("row", VERBS, ids=lambda row: row[0])
def test_no_verb_takes_longer_than_the_table_says(
    row: tuple[str, str, str], number: int, monkeypatch: pytest.MonkeyPatch, tmp_path: object
) -> None:
    monkeypatch.chdir(str(tmp_path))
    # What the thread that writes a recording needs must take no time of the driven clock.
    monkeypatch.setattr("lidario.recording.record.POLL_S", 0.0)
    taken = {}
    for fault in HARM:
        Path("scan.svg").unlink(missing_ok=True)
        words = row[0].replace("SOURCE", in_memory(MODELS[number], f"fault={fault}"))
        ended, taken[fault] = invoked(words.split())
        assert ended.exit_code in (0, 2, 5), ended.stderr
    bound = float(row[1 + number])
    # The table is no guess: what it says is nearly reached.
    assert bound / 2 <= max(taken.values()) <= bound, taken
