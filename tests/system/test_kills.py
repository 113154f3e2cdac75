"""Whoever is killed, and however: no drive keeps its torque, and no sample is lost.

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

import pytest
from support.killing import PATIENT, Killed, Victim, bound_s, own_state
from support.stalls import witnessed
from support.wire import WireRig, wire_rig

SAMPLE = [
    ("daemon", signal.SIGKILL),
    ("cycle", signal.SIGKILL),
    ("recorder", signal.SIGKILL),
    ("all", signal.SIGKILL),
    ("daemon", signal.SIGSTOP),
    ("cycle", signal.SIGSTOP),
    ("all", signal.SIGSTOP),
    ("daemon", signal.SIGTERM),
    ("all", signal.SIGHUP),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("wire"), "wire-kills", PATIENT) as rig:
        yield rig


@pytest.mark.parametrize(("victim", "number"), SAMPLE, ids=lambda item: getattr(item, "name", item))
def test_a_kill_leaves_a_safe_rig_and_every_sample(
    bench: WireRig, tmp_path: Path, victim: str, number: signal.Signals
) -> None:
    state = own_state(tmp_path)
    run = Victim(bench, tmp_path, state)
    try:
        with witnessed() as lost_s:
            time.sleep(random.Random(f"{victim}{number}").random())  # any phase of the movement
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
    shutil.rmtree(state)
