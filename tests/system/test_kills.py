"""After the kill of any process, in any way: no drive keeps its torque, and no sample is lost.

A small sample of the table that ``benchmarks/kill_table.py`` runs whole, on the shipped rig with
its devices simulated at the wire.
"""

from __future__ import annotations

import random
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.faults.killing import (
    CAPTURING,
    HELD,
    HELD_S,
    HOLDING,
    PATIENT,
    QUARTER,
    RIM_HOLD,
    Killed,
    Movement,
    Victim,
    bound_s,
    captured,
    own_state,
)
from support.faults.stalls import witnessed
from support.wire import WireRig, wire_rig

from rigd.record import Recording

#: Every process is killed, stopped and asked to end once. The recorder, without which a run goes
#: on, is hit in runs that another hit ends.
SAMPLE = [
    ("daemon", signal.SIGKILL, None),
    ("cycle", signal.SIGKILL, signal.SIGKILL),
    ("all", signal.SIGKILL, None),
    ("daemon", signal.SIGSTOP, None),
    ("cycle", signal.SIGSTOP, None),
    ("all", signal.SIGSTOP, None),
    ("daemon", signal.SIGTERM, signal.SIGSTOP),
    ("cycle", signal.SIGTERM, signal.SIGTERM),
    ("all", signal.SIGHUP, None),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("wire"), "wire-kills", QUARTER) as rig:
        yield rig.without("accelerometer")  # which takes a process more for each run


@pytest.mark.parametrize(
    ("victim", "number", "recorder"), SAMPLE, ids=lambda item: getattr(item, "name", item)
)
def test_kill_leaves_safe_rig_and_every_sample(
    bench: WireRig,
    tmp_path: Path,
    victim: str,
    number: signal.Signals,
    recorder: signal.Signals | None,
) -> None:
    state = own_state(tmp_path)
    run = Victim(bench, tmp_path, state, CAPTURING)
    try:
        with witnessed() as lost_s:
            if recorder is not None:
                run.hit_recorder(recorder)
            time.sleep(random.Random(f"{victim}{number}").uniform(0, 0.5))  # any phase
            killed: Killed = run.hit(victim, number)
            stalled_s = lost_s()
    finally:
        run.end()
    assert killed.safe_after_s < bound_s(bench, victim, number) + stalled_s
    assert killed.gaps == 0
    assert killed.last_row_s > -0.02 - stalled_s
    if run.process.returncode in (-signal.SIGKILL, None):
        assert killed.ending == "interrupted"
    else:
        assert killed.ending in ("aborted", "stopped", "faulted")
        assert killed.ending in killed.told
    dies = victim != "daemon" and number in (signal.SIGKILL, signal.SIGSTOP)
    missing, others = captured(Recording.open(run.recording), HELD_S if dies else 0.0)
    assert (missing, others) == (0, 0)
    shutil.rmtree(state)


@pytest.fixture(scope="module")
def holding_bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    folder = tmp_path_factory.mktemp("wire")
    with wire_rig(folder, "wire-holding", PATIENT | RIM_HOLD) as rig:
        yield rig.without("accelerometer")


@pytest.mark.parametrize(
    ("victim", "movement"),
    [("cycle", HOLDING), ("all", HOLDING), ("cycle", HELD), ("daemon", HELD)],
    ids=["cycle", "all", "cycle held", "daemon held"],
)
def test_kill_while_controller_acts_leaves_safe_rig(
    holding_bench: WireRig, tmp_path: Path, victim: str, movement: Movement
) -> None:
    state = own_state(tmp_path)
    run = Victim(holding_bench, tmp_path, state, movement)
    try:
        if movement is HELD:
            run.hold()
        with witnessed() as lost_s:
            killed = run.hit(victim, signal.SIGKILL)
            stalled_s = lost_s()
    finally:
        run.end()
    assert killed.safe_after_s < bound_s(holding_bench, victim, signal.SIGKILL) + stalled_s
    assert killed.gaps == 0
    recording = Recording.open(run.recording)
    assert np.any(recording.read("rim_hold")["active"] == 1.0)
    phases = [event.data["phase"] for event in recording.events() if event.kind == "hold"]
    assert phases == (["held"] if movement is HELD else [])
    shutil.rmtree(state)
