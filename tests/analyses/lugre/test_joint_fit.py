"""Floors and masses in one fit (`rigd identify --joint`): narrower, or each by itself."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.lugre.bench import known_rig

from rigd.analysis import ConfigError, DataError, Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.output_error.joint_fit import join
from rigd.analysis.parameters import Group, ParameterEvaluation
from rigd.analysis.recordings.source import RecordedSweep, open_sweep
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder
from rigd_analyses.lugre.conclusion import conclude_group
from rigd_analyses.lugre.joint_floors import check_joint, identify_together
from rigd_analyses.lugre.rig.family import RigFit, fit_group
from rigd_analyses.lugre.rig.system import OF_THE_RIG
from rigd_analyses.lugre.trials.known_constants import Known

Bench = Callable[..., Any]
CURRENTS_A = (0.3, 0.7, 1.2)
TOGETHER = Options(joint=True)


def first_fit(bench: Bench, floor: str, *, current_gain: float = 1.0) -> RigFit:
    rig = bench(floor)
    trials = [
        replace(trial, motor_current_a=current_gain * trial.motor_current_a)
        for trial in rig.sweep(3, CURRENTS_A)
    ]
    weighed = known_rig(rig.constants, guide_lift=Known(0.0, 0.0))  # no fit narrows the load
    return fit_group(trials, rig.constants, weighed)


@pytest.fixture(scope="module")
def floors(bench: Bench) -> list[RigFit]:
    return [first_fit(bench, "stone"), first_fit(bench, "pvc")]


def test_floors_with_shared_constants_are_known_better(floors: list[RigFit], bench: Bench) -> None:
    joint = join(
        [item.whole for item in floors], OF_THE_RIG, [item.family.block for item in floors]
    )
    assert not joint.differing
    assert [item.name for item in joint.constants] == list(OF_THE_RIG)
    pvc = floors[1]
    alone = conclude_group(pvc).parameter("sigma_0")
    shared = conclude_group(replace(pvc, whole=joint.fits[1])).parameter("sigma_0")
    assert shared.low is not None and shared.high is not None
    assert alone.low is not None and alone.high is not None
    assert shared.low <= bench("pvc").truth.s0 <= shared.high
    assert shared.high - shared.low < 0.9 * (alone.high - alone.low)


def test_floor_that_cannot_answer_stops_no_other(floors: list[RigFit]) -> None:
    stone, pvc = floors
    system = pvc.family.system
    jumping = [replace(trial, jumps=np.ones_like(trial.jumps)) for trial in system.trials]
    unseen = replace(pvc.family, system=replace(system, trials=tuple(jumping)))
    silent = replace(pvc, family=unseen)
    groups = [Group("stone", []), Group("pvc", [])]
    found, refused, account = identify_together(groups, [(stone, []), (silent, [])], TOGETHER)
    assert [group.label for group, _ in found] == ["stone"]
    assert [item.group for item in refused] == ["pvc"]
    assert "the bristle slides in no trial" in refused[0].reason
    assert list(account.narrower) == ["stone"]


def test_floors_with_unlike_drives_stay_apart(floors: list[RigFit], bench: Bench) -> None:
    other = first_fit(bench, "pvc", current_gain=1.02)
    pair = (floors[0], other)
    joint = join([item.whole for item in pair], OF_THE_RIG, [item.family.block for item in pair])
    assert joint.differing[0].name == "drive_gain"
    assert joint.fits == tuple(item.whole for item in pair)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three masses on PVC, two currents each."""
    path = tmp_path_factory.mktemp("masses") / "masses.mcap"
    text = (shipped_folder("procedures") / "validation_masses.yaml").read_text("utf-8")
    every = "{from: 0.45 A, to: 1.5 A, step: 0.15 A}"
    assert every in text
    procedure = path.with_suffix(".yaml")
    procedure.write_text(text.replace(every, "{from: 0.45 A, to: 1.05 A, step: 0.6 A}"), "utf-8")
    rig, source = load_rig("lugre-1"), load_procedure(procedure)
    compiled = compile_procedure(source, rig, {"floor": "pvc"})
    execute(RunRequest(compiled, source.file.text, rig, 5, output=path))
    return path


def test_masses_on_one_floor_share_friction(recorded: Path) -> None:
    found = evaluate([recorded], TOGETHER)
    assert isinstance(found, ParameterEvaluation)
    assert [section.label for section in found.sections] == ["pvc"]
    result = found.sections[0].result
    for name, truth in (("mu_s", 0.15), ("mu_c", 0.12), ("sigma_0", 49.933), ("sigma_2", 2.8084)):
        entry = result.parameter(name)
        assert entry.low is not None and entry.high is not None, name
        assert entry.low <= truth <= entry.high, name
        # The data are a little more like another exponent (p = 0.07), which would move mu_s most.
        assert entry.high - entry.low < (0.04 if name == "mu_s" else 0.025) * truth, name
    assert next(t for t in result.residual_tests if t.name == "agreement of masses").passed
    assert len({trial.label for trial in result.trials}) == 6
    saved = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert saved["conditions"] == {"floor": "pvc"}
    assert "one friction for all masses, 3.9593 kg, 2.9593 kg" in saved["joint"]["sentences"][0]


def test_another_method_fits_nothing_jointly(recorded: Path) -> None:
    with pytest.raises(ConfigError, match="--joint: output error alone"):
        evaluate([recorded], Options(method="slip-force", joint=True))


@pytest.mark.parametrize("change", ["rig", "torque_constant"])
def test_recordings_of_unlike_rigs_are_refused(recorded: Path, change: str) -> None:
    sweep = open_sweep(recorded)
    other: RecordedSweep
    if change == "rig":
        other = replace(sweep, info=replace(sweep.info, rig="lugre-2"))
    else:
        constants = {**sweep.plan.constants, change: 0.03}
        other = replace(sweep, plan=replace(sweep.plan, constants=constants))
    with pytest.raises(DataError, match=change):
        check_joint([sweep, other], TOGETHER)
