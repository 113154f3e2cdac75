"""Devices fail on the rig at the wire: the run ends safe, marks its rows, or is never armed.

A seeded sample of the campaign that ``benchmarks/fault_campaign.py`` runs whole, and what must be
refused before anything moves.
"""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.campaign import Campaign, Outcome, verdict
from support.command import rigd
from support.fault_table import Case, Must, cases
from support.killing import PATIENT, own_state
from support.wire import WireRig, wire_rig

from rigd.model.errors import Exit
from rigd.record import Recording

#: What an operator is most likely to get wrong before a run.
REFUSED = (
    "wheel_servo wrong_node before",
    "longitudinal_belt twin before",
    "wheel_encoder mapping_refused before",
    "lateral_belt watchdog_dead before",
    "servo_bus second_rigd before",
    "scale unit(unit=lb) before",
)
KNOWN = {item.name: item for item in cases()}


def sample() -> list[Case]:
    """Three faults that end a run, and three that one run goes through."""
    draw = random.Random(20261121)
    playable = [item for item in KNOWN.values() if not item.before and not item.spoils]
    ending = [item for item in playable if item.must is Must.END]
    going_on = [item for item in playable if item.must is not Must.END and item.watch_s <= 2.0]
    return [*draw.sample(going_on, 3), *draw.sample(ending, 3)]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("wire"), "wire-fails", PATIENT) as rig:
        yield rig


def played(bench: WireRig, folder: Path, chosen: list[Case]) -> dict[str, Outcome]:
    found: dict[str, Outcome] = {}

    def report(case: Case, outcome: Outcome) -> None:
        found[case.name] = outcome

    campaign = Campaign(bench, folder, report)
    for case in chosen:
        campaign.play(case)
    campaign.finish()
    assert found.keys() == {case.name for case in chosen}
    return found


def test_every_fault_that_the_simulation_knows_is_in_the_table(bench: WireRig) -> None:
    parts = bench.ask(do="faults")["parts"]
    known = {(part, fault) for part, faults in parts.items() for fault in faults}
    known -= {("traction", "crc")}  # its line is TCP, which has no check sum of its own
    injected = {(item.part, item.fault) for item in KNOWN.values() if item.edit is None}
    assert injected - {("servo_bus", "second_rigd")} == known


def test_a_sample_of_faults_is_met_as_it_must_be(bench: WireRig, tmp_path: Path) -> None:
    outcomes = played(bench, tmp_path, sample())
    wrong = {name: verdict(KNOWN[name], outcome) for name, outcome in outcomes.items()}
    assert not any(wrong.values()), (wrong, outcomes)


@pytest.mark.parametrize("name", REFUSED)
def test_a_run_is_refused_before_anything_moves(bench: WireRig, tmp_path: Path, name: str) -> None:
    (outcome,) = played(bench, tmp_path, [KNOWN[name]]).values()
    assert not verdict(KNOWN[name], outcome), outcome


def test_a_verdict_misses_nothing() -> None:
    case = KNOWN["wheel_servo emergency(code=29445)"]
    sound = Outcome("device fault", 0.02, 0.03, False, True, int(Exit.TRIPPED),
                    "wheel_servo: emergency 0x7305")  # fmt: skip
    assert not verdict(case, sound)
    late = Outcome(**{**vars(sound), "detected_s": 3.0})
    missed = Outcome("nothing", None, None, False, True, None, "")
    torn = Outcome(**{**vars(sound), "whole": False})
    assert [bool(verdict(case, item)) for item in (late, missed, torn)] == [True] * 3
    refused = KNOWN["scale unit(unit=lb) before"]
    driven = Outcome("refused", 1.0, None, True, True, int(Exit.BLOCKED), "shows lb, not kg")
    assert verdict(refused, driven) == ["a drive was driven"]


PROCEDURE = """\
procedure: fails
title: A drive reports an emergency while it moves
doc: For tests.
trial:
  steps:
    - fault: {part: wheel_servo, fault: emergency, after: 0.2 s, options: {code: 0x2310}}
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.3 A, frequency: 2 Hz}}}
      for: 600 s
"""


def test_a_procedure_shows_a_fault_itself(bench: WireRig, tmp_path: Path) -> None:
    (tmp_path / "fails.yaml").write_text(PROCEDURE)
    state = own_state(tmp_path)
    words = ("run", "fails.yaml", "--rig", bench.rig, "--output", "run.mcap")
    done = rigd(*words, cwd=tmp_path, state=state)
    shutil.rmtree(state)
    assert done.code == Exit.TRIPPED, done.err
    assert "0x2310" in done.out
    events = list(Recording.open(tmp_path / "run.mcap").events())
    (shown,) = (event for event in events if event.kind == "fault_shown")
    assert (shown.data["part"], shown.data["options"]) == ("wheel_servo", {"code": 0x2310})
    (fault,) = (event for event in events if event.kind == "fault")
    assert 0.15e9 < fault.t_ns - shown.t_ns < 2e9
