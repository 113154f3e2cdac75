"""Actuators on lines, CAN and Modbus in whole runs: followed, made safe, seen at the device."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd
from support.faults.campaign import Campaign, Outcome, verdict
from support.faults.killing import kill_cycle
from support.faults.rigs import RIGS, SUPPLYING, lines_rig
from support.faults.stalls import longest_stall
from support.faults.table import Case
from support.wire import WireRig

from rigd.model.errors import Exit
from rigd.record import Recording

SHORT = """\
procedure: short
title: The supply holds two voltages
doc: For tests.
trial:
  steps:
    - step: low
      set: {supply.voltage: 2 V}
      for: 0.7 s
    - step: high
      set: {supply.voltage: 8 V}
      for: 0.7 s
record: all
"""
#: A kill is met over a second connection: after the process that starts for that, in s.
RESCUED_S = 1.0
#: A stall of this length may be taken for a fault, in s.
STALL_S = 0.05


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with lines_rig(tmp_path_factory.mktemp("lines"), dialects=()) as rig:
        yield rig


@pytest.fixture(autouse=True)
def sound(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    if "bench" in request.fixturenames:
        request.getfixturevalue("bench").ask(do="clear")


def test_supply_follows_and_is_off_after_the_run(bench: WireRig, tmp_path: Path) -> None:
    (tmp_path / "short.yaml").write_text(SHORT)
    words = ("run", "short.yaml", "--rig", bench.rig, "--output", "run.mcap", "--yes")
    ran = rigd(*words, cwd=tmp_path)
    assert ran.code == Exit.OK, ran.err
    rows = Recording.open(tmp_path / "run.mcap").read("supply")
    voltages = np.round(rows["voltage"], 3)
    assert {2.0, 8.0} <= set(voltages)
    assert np.nanmax(np.abs(rows["current"] - rows["voltage"] / 10.0)) < 1e-3
    supply = bench.parts()["supply"]
    assert not supply["output"]
    assert supply["set_voltage"] == 0.0


def test_supply_that_stays_on_is_named(bench: WireRig, tmp_path: Path) -> None:
    fault = "    - fault: {part: supply, fault: stuck, after: 0.3 s}\n"
    high = "    - step: high\n"
    (tmp_path / "short.yaml").write_text(SHORT.replace(high, fault + high))
    words = ("run", "short.yaml", "--rig", bench.rig, "--output", "run.mcap", "--yes")
    ran = rigd(*words, cwd=tmp_path)
    assert ran.code == Exit.TRIPPED, ran.err
    told = " ".join(ran.out.split())
    assert "supply does not confirm that it is safe" in told
    assert "it answers '1' to b'OUTP?" in told


def test_killed_cycle_leaves_supply_off(bench: WireRig, tmp_path: Path) -> None:
    killed, stalled_s = kill_cycle(bench, tmp_path, SUPPLYING)
    assert killed.safe_after_s < RESCUED_S + stalled_s
    assert killed.gaps == 0
    assert not bench.parts()["supply"]["output"]


@pytest.mark.parametrize(
    ("rig", "fault"),
    [("belt", "servo_bus drop"), ("belt", "lateral_belt blocked"),
     ("inverter", "lateral_drive blocked"), ("inverter", "lateral_drive stuck"),
     ("inverter", "lateral_drive setpoint_ignored"), ("inverter-rtu", "lateral_drive crc"),
     ("lines", "supply setpoint_ignored"), ("angle", "relay one_shot_dead")],
)  # fmt: skip
def test_fault_of_an_actuator_is_named(rig: str, fault: str, tmp_path: Path) -> None:
    chosen = RIGS[rig]
    (case, *_) = (item for item in chosen.cases if item.name.startswith(f"{rig}: {fault}"))
    for _ in range(3):
        found: dict[str, list[str]] = {}

        def report(case: Case, outcome: Outcome, found: dict[str, list[str]] = found) -> None:
            found[case.name] = [f"{item}: {outcome}" for item in verdict(case, outcome)]

        with chosen.served(tmp_path) as served, longest_stall() as stall_s:
            campaign = Campaign(
                served, tmp_path, report, chosen.movement, chosen.set_up, chosen.by_hand
            )
            campaign.play(case)
            campaign.finish()
        if not found[case.name] or stall_s() < STALL_S:
            break
    assert found == {case.name: []}
