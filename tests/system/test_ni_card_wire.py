"""The LuGre rig on a simulated NI card: after any kill its outputs give 0 V, no sample is lost."""

from __future__ import annotations

import json
import random
import re
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.commands.command import rigd
from support.faults.killing import Victim, bound_s, own_state
from support.faults.rigs import NI_SHAKING
from support.faults.stalls import witnessed
from support.wire import NI, WireRig, wire_rig

from rigd.model.errors import Exit

#: Every process is killed, stopped and asked to end once; the recorder in runs that another ends.
SAMPLE = [
    ("cycle", signal.SIGKILL, signal.SIGKILL),
    ("all", signal.SIGKILL, None),
    ("daemon", signal.SIGKILL, None),
    ("recorder", signal.SIGKILL, None),
    ("daemon", signal.SIGSTOP, None),
    ("cycle", signal.SIGSTOP, None),
    ("all", signal.SIGSTOP, None),
    ("daemon", signal.SIGTERM, None),
    ("cycle", signal.SIGTERM, None),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("wire"), "ni-kills", shipped=NI) as rig:
        yield rig


@pytest.mark.parametrize(
    ("victim", "number", "recorder"), SAMPLE, ids=lambda item: getattr(item, "name", item)
)
def test_kill_leaves_outputs_at_rest_and_every_sample(
    bench: WireRig,
    tmp_path: Path,
    victim: str,
    number: signal.Signals,
    recorder: signal.Signals | None,
) -> None:
    state = own_state(tmp_path)
    run = Victim(bench, tmp_path, state, NI_SHAKING)
    try:
        with witnessed() as lost_s:
            if recorder is not None:
                run.hit_recorder(recorder)
            time.sleep(random.Random(f"{victim}{number}").uniform(0, 0.5))  # any phase
            killed = run.hit(victim, number)
            stalled_s = lost_s()
    finally:
        run.end()
        shutil.rmtree(state)
    card = bench.parts()["ni_card"]
    assert [card[f"ao{output}"] for output in range(3)] == [0.0, 0.0, 0.0]
    assert card["lines"] == 0
    assert killed.safe_after_s < bound_s(bench, victim, number, NI_SHAKING) + stalled_s
    assert killed.gaps == 0
    # One cycle of 20 ms was under way.
    assert killed.last_row_s > -0.04 - stalled_s or victim == "recorder"


def test_quick_procedure_completes_on_the_card(bench: WireRig, tmp_path: Path) -> None:
    ended = rigd("run", "quick", "--rig", bench.rig, "--yes", "--json", cwd=tmp_path)
    told = json.loads(ended.out)
    assert told["state"] in ("complete", "incomplete"), ended.err  # cycles may be late here
    card = bench.parts()["ni_card"]
    assert (card["ao0"], card["lines"], card["tasks"]) == (0.0, 0, 0)


SPOILT = """
procedure: spoilt
title: A fault of the card
doc: For tests.
trial:
  steps:
    - step: push
      set: {wheel_servo.current: 0.4 A}
      for: 0.5 s
    - fault: {part: ni_card, fault: FAULT}
    - step: go_on
      for: 20 s
record: all
"""


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("watchdog_expired", "the one-shot dropped|watchdog of NI card Dev1"),
        ("reset", "NI-DAQmx -200088"),
        ("removal", "is gone"),
        # A computer that is late beside it ends the run by its own supervision.
        ("stall, options: {seconds: 1.0}", "the device server fails|gave no sign of life"),
    ],
)
def test_fault_of_card_ends_run_with_its_name(
    bench: WireRig, tmp_path: Path, fault: str, words: str
) -> None:
    (tmp_path / "spoilt.yaml").write_text(SPOILT.replace("FAULT", fault))
    try:
        ended = rigd("run", "spoilt.yaml", "--rig", bench.rig, "--yes", cwd=tmp_path)
        assert bench.parts()["ni_card"]["ao0"] == 0.0
        assert not bench.parts()["ni_card"]["enabled"]
    finally:
        bench.ask(do="clear")
    assert ended.code == Exit.TRIPPED, ended.out + ended.err
    assert re.search(words, " ".join((ended.out + ended.err).split()))


def test_watchdog_that_does_not_act_is_not_armed(bench: WireRig, tmp_path: Path) -> None:
    bench.ask(do="fault", part="ni_card", fault="watchdog_dead")
    try:
        ended = rigd("run", "quick", "--rig", bench.rig, "--yes", cwd=tmp_path)
    finally:
        bench.ask(do="clear")
    assert ended.code == Exit.BLOCKED, ended.err
    assert "watchdog of the card was still up" in " ".join(ended.err.split())
