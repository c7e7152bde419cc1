"""The fuzz targets hold on their seeds and on a few more bytes, and can themselves fail."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidario.errors import ConnectFailed
from lidario.session.talking.dialogue import Dialogue
from tests.fuzz import targets
from tests.fuzz.__main__ import main
from tests.fuzz.packets import make_scans, packets_of
from tests.fuzz.targets import TARGETS
from tests.support import ledger
from tests.support.cases import KINDS, LAYOUTS, Case, named
from tests.support.contents import any_packets
from tests.support.harm import messes
from tests.support.samples import one_a_parser

pytestmark = pytest.mark.discards("a device that means harm answers what was not asked, and leaves out what was")


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_a_target_holds_on_its_seeds(name: str) -> None:
    target = TARGETS[name]
    assert len(target.seeds) > 5
    for seed in (b"", *target.seeds):
        target.run(seed)


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=10)
@given(st.data())
def test_a_target_holds_on_other_bytes(name: str, data: st.DataObject) -> None:
    target = TARGETS[name]
    seed = data.draw(st.sampled_from(list(target.seeds)))
    at = data.draw(st.integers(0, len(seed)))
    target.run(seed[:at] + data.draw(st.binary(max_size=40)) + seed[at:])


@pytest.mark.long
@settings(max_examples=settings().max_examples * 20)
@given(st.data(), st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_no_bytes_raise_in_any_state(data: st.DataObject, number: int, state: int, chunk: int) -> None:
    """Of any format: a mess of golden packets, damage and what begins like a packet."""
    case = KINDS[number % len(KINDS)]
    mess = data.draw(messes(case), "mess")
    TARGETS["link"].run(bytes((number, state, chunk)) + mess)


@one_a_parser([*KINDS, *LAYOUTS], KINDS)
@pytest.mark.parametrize("wild", [False, True], ids=["turning", "wild"])
@given(st.integers(0, 2**32), st.integers(1, 150), st.integers(1, 60), st.integers(0, 255))
def test_any_contents_become_scans(case: Case, wild: bool, seed: int, count: int, run: int, times: int) -> None:
    packets = any_packets(case, seed, count, wild=wild)
    if case.response_type != 0x81 or case.layout is not None:
        found = case.make_format().run(bytearray(b"".join(packets)), 0)
        assert sum(block.packets for block in found.packets) == count
    make_scans(case, packets, run, times)


@pytest.mark.parametrize("case", KINDS, ids=named)
def test_bytes_become_packets_of_every_format(case: Case) -> None:
    found = packets_of(case, b"".join(case.packets[:60]))
    assert len(found) >= 40
    for packet in found:
        assert case.make_format().intact(bytearray(packet), 0, len(packet))


def test_a_byte_that_is_not_counted_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ledger, "BYTES", tuple(name for name in ledger.BYTES if name != "stray_bytes"))
    with pytest.raises(AssertionError, match="accounted for"):
        for seed in TARGETS["link"].seeds:
            TARGETS["link"].run(seed)


def test_a_mistake_of_ours_is_found_by_the_hostile_device(monkeypatch: pytest.MonkeyPatch) -> None:
    def blunder(dialogue: Dialogue) -> None:
        raise IndexError("a bug")

    monkeypatch.setattr(Dialogue, "taken", blunder)
    with pytest.raises(AssertionError, match=r"IndexError\('a bug'\)"):
        TARGETS["device"].run(bytes(4))


def test_a_foreign_exception_is_found_by_the_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(text: str) -> None:
        raise ConnectFailed(f"{text}: \x1b[2J", reason="source")

    monkeypatch.setattr(targets, "parse_source", careless)
    with pytest.raises(AssertionError, match=r"\\x1b"):
        TARGETS["source"].run(b"COM3")


def test_the_command_repeats_a_finding_and_names_the_targets(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["link", "--repeat", TARGETS["link"].seeds[0].hex()]) == 0
    assert main(["nothing"]) == 2
    told = capsys.readouterr().err
    assert all(name in told for name in TARGETS)
