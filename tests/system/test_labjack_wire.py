"""The LuGre rig on a simulated LabJack: a kill leaves its drives disabled, and every sample."""

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
from support.faults.rigs import LABJACK_SHAKING
from support.faults.stalls import witnessed
from support.wire import LABJACK, WireRig, wire_rig

from rigd.model.errors import Exit

#: Processes that are killed, stopped and asked to end.
SAMPLE = [
    ("cycle", signal.SIGKILL),
    ("all", signal.SIGKILL),
    ("daemon", signal.SIGKILL),
    ("cycle", signal.SIGSTOP),
    ("all", signal.SIGSTOP),
    ("daemon", signal.SIGSTOP),
    ("cycle", signal.SIGTERM),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("wire"), "labjack-kills", shipped=LABJACK) as rig:
        yield rig


@pytest.mark.parametrize(("victim", "number"), SAMPLE, ids=lambda item: getattr(item, "name", item))
def test_kill_leaves_drives_disabled_and_every_sample(
    bench: WireRig, tmp_path: Path, victim: str, number: signal.Signals
) -> None:
    state = own_state(tmp_path)
    run = Victim(bench, tmp_path, state, LABJACK_SHAKING)
    try:
        with witnessed() as lost_s:
            time.sleep(random.Random(f"{victim}{number}").uniform(0, 0.5))  # any phase
            killed = run.hit(victim, number)
            stalled_s = lost_s()
    finally:
        run.end()
        shutil.rmtree(state)
    device = bench.parts()["labjack"]
    assert device["lines"] == 0
    assert not device["enabled"]
    if victim != "all":  # the watchdog cannot set an LJTick-DAC; a process that is left does
        assert (device["TDAC4"], device["TDAC5"]) == (0.0, 0.0)
    assert killed.safe_after_s < bound_s(bench, victim, number, LABJACK_SHAKING) + stalled_s
    assert killed.gaps == 0
    # One cycle of 5 ms was under way.
    assert killed.last_row_s > -0.04 - stalled_s


def test_quick_procedure_completes_on_the_device(bench: WireRig, tmp_path: Path) -> None:
    ended = rigd("run", "quick", "--rig", bench.rig, "--yes", "--json", cwd=tmp_path)
    told = json.loads(ended.out)
    assert told["state"] in ("complete", "incomplete"), ended.err  # cycles may be late here
    device = bench.parts()["labjack"]
    assert (device["TDAC4"], device["lines"]) == (0.0, 0)


SPOILT = """
procedure: spoilt
title: A fault of the device
doc: For tests.
trial:
  steps:
    - step: push
      set: {wheel_servo.current: 0.4 A}
      for: 0.5 s
    - fault: {part: labjack, fault: FAULT}
    - step: go_on
      for: 20 s
record: all
"""


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("watchdog_acts", "the one-shot dropped|watchdog of LabJack"),
        ("garbage, options: {count: 1}", "expected protocol 0"),
        ("silent, options: {count: 40}", "has not answered within"),
        ("failed_input", "reads -9999 V"),
    ],
)
def test_fault_of_device_ends_run_with_its_name(
    bench: WireRig, tmp_path: Path, fault: str, words: str
) -> None:
    (tmp_path / "spoilt.yaml").write_text(SPOILT.replace("FAULT", fault))
    try:
        ended = rigd("run", "spoilt.yaml", "--rig", bench.rig, "--yes", cwd=tmp_path)
    finally:
        bench.ask(do="clear")
    assert ended.code == Exit.TRIPPED, ended.out + ended.err
    assert re.search(words, " ".join((ended.out + ended.err).split()))
    assert not bench.parts()["labjack"]["enabled"]


def test_watchdog_that_does_not_act_is_not_armed(bench: WireRig, tmp_path: Path) -> None:
    bench.ask(do="fault", part="labjack", fault="watchdog_dead")
    try:
        ended = rigd("run", "quick", "--rig", bench.rig, "--yes", cwd=tmp_path)
    finally:
        bench.ask(do="clear")
    assert ended.code == Exit.BLOCKED, ended.err
    assert "watchdog of the card was still up" in " ".join(ended.err.split())
