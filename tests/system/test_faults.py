"""Devices fail on the rig at the wire: the run ends safe, marks its rows, or is never armed.

A slice of the campaign that ``benchmarks/fault_campaign.py`` runs whole: of the devices on every
bus one fault that ends a run, one that marks rows, one that a run goes on through and one that
keeps it from being armed.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from inspect import isabstract
from pathlib import Path

import pytest
from support.commands.command import rigd
from support.faults.campaign import MARKED as MARKED_ROWS
from support.faults.campaign import Campaign, Outcome, cause_in, verdict
from support.faults.killing import QUARTER, own_state
from support.faults.rigs import RIGS, FaultRig, every_case
from support.faults.stalls import longest_stall
from support.faults.table import SECOND, Case, Must, cases
from support.wire import WireRig, all_parts, wire_rig

from rigd.config.loader import load_rig
from rigd.model.errors import Exit
from rigd.record import Recording
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.part import Part
from rigd_sim.wire.service import WireSimulation

KNOWN = {item.name: item for item in cases()}
#: Both buses of CAN, the NI card, the scale's serial line and Modbus: shown at the same time.
MARKED = (
    "wheel_servo tpdo_missing(probability=0.5)",
    "carriage tpdo_missing(probability=0.5)",
    "accelerometer saturation(channel=ai0,side=high)",
    "scale overload",
    "traction silent(count=1)",
)
GONE_THROUGH = (
    "longitudinal_belt sdo_wrong_toggle",
    "wheel_encoder index_reset",
    "accelerometer stuck_code(channel=ai0)",
    "scale nul",
    "traction frozen",
)
#: Each ends a run of its own; that of the servos' bus is shown by a procedure, below.
ENDING = ("wheel_encoder tpdo_short", "scale silent", "traction exception")
#: What an operator is most likely to get wrong before a run, all of it named at once.
REFUSED = (
    "wheel_servo wrong_node before",
    "longitudinal_belt twin before",
    "wheel_encoder mapping_refused before",
    "accelerometer removal before",
    "scale unit(unit=lb) before",
    "traction word_order before",
)
#: A rig on which another shows some faults again, while something else moves.
AGAIN = ("belt",)
#: What a line cannot show: TCP has no check sum of its own, RTU no number of a transaction.
IMPOSSIBLE = {name: {"crc"} for name in ("wire-1", "inverter", "labjack")} | {
    "inverter-rtu": {"wrong_transaction"}
}
#: A stall of this length may end a run, or mark its rows, before a fault does, in s.
STALL_S = 0.05
TRIES = 3


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    """The rig with every device."""
    with wire_rig(tmp_path_factory.mktemp("wire"), "wire-fails", QUARTER) as rig:
        yield rig


@pytest.fixture(scope="module")
def small(whole: WireRig) -> WireRig:
    """The same without the card, which takes a process more for each run."""
    return whole.without("accelerometer")


def judged(rig: WireRig, folder: Path, *shown: tuple[str, ...]) -> dict[str, list[str]]:
    """Show faults, those of a tuple at once; return what was wrong with the answer to each.

    A failure while the machine stalls has no meaning: it is then played again.
    """
    for _ in range(TRIES):
        found: dict[str, list[str]] = {}

        def report(case: Case, outcome: Outcome, found: dict[str, list[str]] = found) -> None:
            found[case.name] = [f"{item}: {outcome}" for item in verdict(case, outcome)]

        with longest_stall() as stall_s:
            campaign = Campaign(rig, folder, report)
            for names in shown:
                campaign.play(*(KNOWN[name] for name in names))
            campaign.finish()
        assert found.keys() == {name for names in shown for name in names}
        if not any(found.values()) or stall_s() < STALL_S:
            break
    return {name: wrong for name, wrong in found.items() if wrong}


def simulated(rig: FaultRig, folder: Path) -> dict[str, Part]:
    """Return the devices of a rig by their name, none of them started."""
    with rig.served(folder) as served:
        setup = load_rig(served.rig).simulation
        assert setup is not None
        simulation = setup.simulation_class(setup.config)
        assert isinstance(simulation, WireSimulation)
        _, parts = simulation.build(Folder(served.folder))
    return {part.name: part for part in parts}


def test_every_fault_of_every_device_is_in_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(WireRig, "start", lambda self: None)
    shown: set[type[Part]] = set()
    for name, rig in RIGS.items():
        (tmp_path / name).mkdir()
        parts = simulated(rig, tmp_path / name)
        for part in rig.kinds:
            injected = {item.fault for item in rig.cases if item.part == part and item.injected}
            assert {item.part for item in rig.cases} <= rig.kinds.keys(), name
            assert injected - {SECOND} <= parts[part].faults.keys(), (name, part)
            missing = parts[part].faults.keys() - injected
            assert name in AGAIN or missing <= IMPOSSIBLE.get(name, set()), (name, part)
            if name not in AGAIN:
                shown.update(type(parts[part]).__mro__)
    assert {part for part in all_parts() if part.faults and not isabstract(part)} <= shown


def test_every_end_and_refusal_names_its_cause() -> None:
    named = (Must.END, Must.NAME, Must.BLOCK)
    assert not [item.name for item in every_case() if item.must in named and not item.words]


TOLD = """\
shake (/tmp/a/procedure.yaml) on wire-faults (/tmp/b/wire-faults.yaml), 1 trial, recording to \
/tmp/a/run.mcap
trial 1/1: trial 1 faulted: card: the MF624 is gone; 0 of 1 trials, 0.3 s of rig time
wheel_servo could not be made safe: the MF624 is gone
continue with: rigd run --resume /tmp/a/run.mcap
"""


def test_only_the_cause_is_searched_for_words() -> None:
    cause = "card: the MF624 is gone; 0 of 1 trials, 0.3 s of rig time"
    assert cause_in(TOLD, Must.END) == cause
    assert cause_in(TOLD, Must.NAME).endswith(
        "wheel_servo could not be made safe: the MF624 is gone"
    )
    refused = TOLD.replace("trial 1/1: trial 1 faulted: ", "rigd: the rig is not armed: ")
    assert cause_in(refused, Must.BLOCK).startswith("rigd: the rig is not armed: card")


def test_slice_holds_only_faults_of_its_class() -> None:
    for names, must in (
        (MARKED, Must.MARK), (GONE_THROUGH, Must.GO_ON), (ENDING, Must.END), (REFUSED, Must.BLOCK),
    ):  # fmt: skip
        assert {KNOWN[name].must for name in names} == {must}


def test_run_continues_marks_rows_and_ends(whole: WireRig, tmp_path: Path) -> None:
    assert not judged(whole, tmp_path, GONE_THROUGH, MARKED, ("accelerometer removal",))


@pytest.mark.parametrize("name", ENDING)
def test_a_fault_ends_the_run(small: WireRig, tmp_path: Path, name: str) -> None:
    assert not judged(small, tmp_path, (name,))


def test_refused_run_names_every_cause(whole: WireRig, tmp_path: Path) -> None:
    assert not judged(whole, tmp_path, REFUSED)


@pytest.mark.parametrize(
    "name", ["lateral_belt watchdog_dead before", "servo_bus second_rigd before"]
)
def test_a_run_is_refused_before_anything_moves(small: WireRig, tmp_path: Path, name: str) -> None:
    assert not judged(small, tmp_path, (name,))


def test_verdict_reports_each_deviation_from_expected() -> None:
    case = KNOWN["wheel_servo emergency(code=29445)"]
    sound = Outcome("device fault", 0.02, 0.03, False, True, int(Exit.TRIPPED),
                    "wheel_servo: emergency 0x7305")  # fmt: skip
    assert not verdict(case, sound)
    late = Outcome(**{**vars(sound), "detected_s": 3.0})
    unnamed = Outcome(**{**vars(sound), "detected_by": MARKED_ROWS})
    missed = Outcome("nothing", None, None, False, True, None, "")
    torn = Outcome(**{**vars(sound), "whole": False})
    assert [bool(verdict(case, item)) for item in (late, missed, torn, unnamed)] == [True] * 4
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


def test_a_procedure_shows_a_fault_itself(small: WireRig, tmp_path: Path) -> None:
    (tmp_path / "fails.yaml").write_text(PROCEDURE)
    state = own_state(tmp_path)
    words = ("run", "fails.yaml", "--rig", small.rig, "--output", "run.mcap")
    done = rigd(*words, cwd=tmp_path, state=state)
    shutil.rmtree(state)
    assert done.code == Exit.TRIPPED, done.err
    assert "0x2310" in done.out
    events = list(Recording.open(tmp_path / "run.mcap").events())
    (shown,) = (event for event in events if event.kind == "fault_shown")
    assert (shown.data["part"], shown.data["options"]) == ("wheel_servo", {"code": 0x2310})
    (fault,) = (event for event in events if event.kind == "fault")
    assert 0.15e9 < fault.t_ns - shown.t_ns < 2e9
