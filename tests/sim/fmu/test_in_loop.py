"""An FMU between channels of a rig: when its outputs are of which inputs, and how it fails."""

from __future__ import annotations

import math
import os
import re
import select
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigd.cli.main import main
from rigd.config.loader import parse_rig
from rigd.model.errors import ConfigError, DeviceError, Exit
from rigd.record.read.reader import Recording
from rigd.sdk.check import check_driver
from rigd_sim.fmu.loop_device import FmuInLoop, FmuInLoopConfig

MS = 1_000_000
#: No test waits longer for an answer, in s.
PATIENCE_S = 30.0
OPTIONS: dict[str, Any] = {
    "inputs": {"torque": "motor.torque"},
    "outputs": {"omega": "omega", "temperature": {"variable": "temperature", "unit": "K"}},
}


@contextmanager
def opened(fmu: Path, *, lockstep: bool = True, **options: Any) -> Iterator[FmuInLoop]:
    config = FmuInLoopConfig.model_validate(
        {"file": str(fmu), **OPTIONS, **options}, context={"period_ns": MS}
    )
    model = FmuInLoop(config)
    model.lockstep = lockstep
    model.open()
    try:
        yield model
    finally:
        model.close()


def exchanged(model: FmuInLoop, cycle: int, torque: float) -> list[float] | None:
    """One cycle: its row, then the inputs."""
    row = model.read(cycle * MS)
    model.take_inputs(cycle * MS, [torque], late=False)
    return None if row is None else list(row)


def awaited(model: FmuInLoop, cycle: int) -> list[float]:
    """The row of ``cycle`` as soon as it is there."""
    deadline = time.monotonic() + PATIENCE_S
    while (row := model.read(cycle * MS)) is None:
        assert time.monotonic() < deadline
        time.sleep(PATIENCE_S / 10_000)  # each is a cycle too late, of so many at most
    return list(row)


def test_outputs_follow_inputs_of_cycle_before(flywheel: Path) -> None:
    with opened(flywheel) as model:
        rows = [exchanged(model, cycle, 0.05 * cycle) for cycle in range(4)]
    speeds = [row[0] for row in rows if row is not None]
    gain = 1e-3 / 0.05
    assert speeds == pytest.approx([0.0, 0.0, 0.05 * gain, 0.15 * gain], rel=1e-12)
    assert rows[3] is not None and rows[3][1:] == [293.15, 0.0, 0.0, 0.0]


def test_long_step_gives_row_when_it_ends(flywheel: Path) -> None:
    with opened(flywheel, step="3 ms") as model:
        rows = [exchanged(model, cycle, float(cycle)) for cycle in range(7)]
    assert [row is not None for row in rows] == [True, False, False, True, False, False, True]
    assert rows[6] is not None and rows[6][0] == pytest.approx(3.0 * 3e-3 / 0.05)


def test_short_steps_are_taken_within_one_cycle(flywheel: Path) -> None:
    outputs = {"steps": "steps", "omega": "omega"}
    with opened(flywheel, step="0.25 ms", outputs=outputs) as model:
        rows = [exchanged(model, cycle, 1.0) for cycle in range(3)]
    assert rows[2] is not None and rows[2][:2] == pytest.approx([8.0, 2e-3 / 0.05])


def test_late_model_catches_up_with_time(flywheel: Path) -> None:
    with opened(flywheel, lockstep=False, late=10_000) as model:
        exchanged(model, 0, 1.0)
        row = awaited(model, 3)  # due in cycle 1
        assert row[0] == pytest.approx(1e-3 / 0.05)
        assert (row[3], model.taken_ns) == (2.0, MS)
        model.take_inputs(3 * MS, [1.0], late=True)
        row = awaited(model, 4)
        assert row[0] == pytest.approx(4e-3 / 0.05)
        assert (row[3], model.taken_ns) == (0.0, 4 * MS)
        assert row[2] > 0.0
        assert row[4] == 1.0, "the status shows that an input was late"


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("crash", "the step at 0.001 s crashed: its process was ended by SIGSEGV"),
        ("error", "doStep at 0.001 s returned fatal"),
        ("nan", "'temperature' is nan after 0.002 s"),
        ("hang", "the step at 0.001 s did not return within 0.3 s"),
    ],
)
def test_failing_model_is_named_in_virtual_time(flywheel: Path, fault: str, said: str) -> None:
    start = {"fault": fault, "after": "0.5 ms"}
    with opened(flywheel, start=start, deadline="0.3 s") as model:
        exchanged(model, 0, 0.0)
        exchanged(model, 1, 0.0)
        with pytest.raises(DeviceError, match=said):
            model.read(2 * MS)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("exit", "the step at 0.001 s crashed: its process ended by itself (exit code 3)"),
        ("discard", "doStep at 0.001 s returned discard"),
        ("nan", "'temperature' is nan after 0.002 s"),
    ],
)
def test_failing_model_is_named_in_real_time(flywheel: Path, fault: str, said: str) -> None:
    start = {"fault": fault, "after": "0.5 ms"}
    with opened(flywheel, lockstep=False, start=start, late=10_000) as model:
        exchanged(model, 0, 0.0)
        awaited(model, 1)
        model.take_inputs(MS, [0.0], late=False)
        with pytest.raises(DeviceError, match=re.escape(said)):
            awaited(model, 1 + 1)


@pytest.mark.parametrize("fault", ["hang", "sleep"])
def test_model_that_never_returns_is_late(flywheel: Path, fault: str) -> None:
    start = {"fault": fault, "after": "0 s"}
    options = {"start": start, "budget": "0.5 ms", "deadline": f"{2 * PATIENCE_S} s"}
    with opened(flywheel, lockstep=False, **options) as model:
        exchanged(model, 0, 0.0)
        begun = time.monotonic()
        assert [model.read(cycle * MS) for cycle in (1, 2, 3)] == [None] * 3
        with pytest.raises(DeviceError) as failed:
            model.read(4 * MS)
        assert time.monotonic() - begun < PATIENCE_S, "a cycle has waited for the model"
    assert str(failed.value) == (
        "Flywheel.fmu: the step at 0 s is late by 4 cycles; late or above its budget of 0.5 ms in "
        "4 cycles in succession, and 'late' allows 3"
    )


def test_model_above_its_budget_is_named(flywheel: Path) -> None:
    with opened(flywheel, lockstep=False, budget="1 ns", late=0) as model:
        exchanged(model, 0, 0.0)
        assert model._process is not None
        # With `late: 0` a row that is not there at once is late already.
        assert select.select([model._process._socket], [], [], PATIENCE_S)[0]
        with pytest.raises(DeviceError, match="the step at 0 s is above the budget: "):
            awaited(model, 1)


def test_budget_below_a_step_prevents_arming(flywheel: Path) -> None:
    with opened(flywheel, lockstep=False, budget="1 ns") as model:
        (reason,) = model.preflight()
        assert "the budget is 1e-06 ms" in reason
        model.lockstep = True
        assert model.preflight() == ()


def test_killed_process_is_named_and_gone(flywheel: Path) -> None:
    with opened(flywheel, lockstep=False, late=10_000) as model:
        exchanged(model, 0, 0.0)
        awaited(model, 1)
        assert model._process is not None
        pid = model._process.pid
        os.kill(pid, signal.SIGKILL)
        model.take_inputs(MS, [0.0], late=False)
        with pytest.raises(DeviceError, match="its process was ended by SIGKILL"):
            awaited(model, 2)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_unknown_input_prevents_arming_and_later_fails(flywheel: Path) -> None:
    with opened(flywheel, late=1) as model:
        exchanged(model, 0, math.nan)
        row = exchanged(model, 1, math.nan)
        assert row is not None and math.isnan(row[0])
        with pytest.raises(DeviceError, match=r"not begun: its input motor\.torque is nan"):
            model.arm()
        exchanged(model, 2, 0.5)
        model.arm()
        exchanged(model, 3, math.inf)
        with pytest.raises(DeviceError, match=r"motor\.torque is inf in 2 cycles in succession"):
            exchanged(model, 4, math.inf)


def test_it_keeps_the_promises_of_drivers(flywheel: Path) -> None:
    check_driver(FmuInLoop, {"file": str(flywheel), **OPTIONS})


RIG = """\
rig: twin-1
title: a flywheel, and a model of it beside
cycle: 1 kHz
plant: {model: fmu, file: FILE}
devices:
  bench:
    driver: sim-fmu
    options:
      inputs: {torque: torque}
      outputs: {speed: omega}
    limits:
      torque: {low: -1 N m, high: 1 N m, rate: 100 N m/s}
  twin:
    driver: fmu-in-loop
    options:
      file: FILE
      start: {fault: none, after: 50 ms}
      inputs: {torque: bench.torque_setpoint}
      outputs: {speed: omega}
derived:
  wheel.apart: {is: bench.speed - twin.speed}
interlocks:
  - {name: parted, source: wheel.apart, high: 1 rad/s, action: abort, message: They part.}
"""
PROCEDURE = """\
procedure: spin
title: Spin both
doc: Until the model turns with 1 rad/s.
trial:
  steps:
    - step: spin
      set: {bench.torque: 0.5 N m}
      until: twin.speed > 1 rad/s
      timeout: 1 s
"""


def play(fmu: Path, folder: Path, change: Callable[[str], str] = str) -> int:
    (folder / "rig.yaml").write_text(change(RIG.replace("FILE", str(fmu))))
    (folder / "spin.yaml").write_text(PROCEDURE)
    return main(
        ["run", str(folder / "spin.yaml"), "--rig", str(folder / "rig.yaml"),
         "--output", str(folder / "run.mcap")]
    )  # fmt: skip


def test_model_of_a_rig_runs_beside_it(flywheel: Path, tmp_path: Path) -> None:
    assert play(flywheel, tmp_path) == Exit.OK
    recording = Recording.open(tmp_path / "run.mcap")
    bench, twin = recording.read("bench"), recording.read("twin")
    assert len(bench) > 100
    np.testing.assert_array_equal(twin["t_ns"], bench["t_ns"])
    np.testing.assert_array_equal(twin["speed"], bench["speed"])
    assert "latency_s: 0.001" in recording.attachments["Flywheel.fmu.yaml"].data.decode()


def test_diverged_model_is_named_and_stops_the_rig(
    flywheel: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert play(flywheel, tmp_path, lambda rig: rig.replace("fault: none", "fault: error")) == (
        Exit.TRIPPED
    )
    assert "twin: Flywheel.fmu: doStep at 0.05 s returned fatal" in capsys.readouterr().out
    rows = Recording.open(tmp_path / "run.mcap").read("bench")
    driven = np.flatnonzero(rows["torque_setpoint"] == 0.5)
    assert driven[-1] == 51, "devices are made safe in the cycle of the fault"
    assert driven[-1] + 1 < len(rows), "rows go on until the rig rests"
    assert not rows["torque_setpoint"][driven[-1] + 1 :].any()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("{torque: bench.torque_setpoint}", "{torque: bench.torque}",
         ":18:24: unknown channel 'bench.torque'"),
        ("{torque: bench.torque_setpoint}", "{torque: bench.speed}",
         ":18:24: bench.speed is in rad/s, and twin takes kg m^2/s^2"),
        ("{torque: bench.torque_setpoint}", "{omega: bench.speed}",
         ":18:23: 'omega' is no input of the FMU"),
        ("{torque: bench.torque_setpoint}", "{torqe: bench.speed}",
         ":18:23: Flywheel.fmu has no variable 'torqe'; did you mean 'torque'?"),
        ("{torque: bench.torque_setpoint}", "{free: bench.speed}",
         ":18:22: the FMU gives 'free' no unit"),
        ("      outputs: {speed: omega}\nderived", "      outputs: {speed: torque}\nderived",
         ":19:24: 'torque' is no output of the FMU"),
        ("      outputs: {speed: omega}\nderived", "      outputs: {late: omega}\nderived",
         ":19:23: 'late' is taken"),
        ("      inputs: {torque: b", "      step: 0.3 ms\n      inputs: {torque: b",
         ":18:13: a step of 0.3 ms is neither a cycle of 1 ms nor a whole"),
        ("      inputs: {torque: b", "      step: 2.5 ms\n      inputs: {torque: b",
         ":18:13: a step of 2.5 ms is neither"),
        ("      inputs: {torque: b", "      budget: 1.5 ms\n      inputs: {torque: b",
         ":18:15: a budget of 1.5 ms cannot hold: rows are due every 1 ms"),
        ("fault: none", "fault: setup-error", ":16:13: Flywheel.fmu: exitInitializationMode"),
    ],
)  # fmt: skip
def test_wrong_entry_is_named_with_its_place(
    flywheel: Path, tmp_path: Path, old: str, new: str, said: str
) -> None:
    text = RIG.replace("FILE", str(flywheel))
    assert old in text
    with pytest.raises(ConfigError) as refused:
        parse_rig(text.replace(old, new), tmp_path / "rig.yaml")
    told = "\n".join(str(error) for error in (refused.value, *refused.value.others))
    assert said in told
