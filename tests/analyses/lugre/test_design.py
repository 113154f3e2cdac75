"""Checks predicted motion, chosen tests and promised intervals of designed procedures.

``benchmarks/design_promise.py`` plays and identifies designed procedures on all floors.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.lugre.model import PVC, SENSOR_ROWS, fitted_constants, saved_model

from rigd.analysis import ConfigError, DataError
from rigd.analysis.design.command import DesignRequest, Ground, design
from rigd.analysis.design.optimal import choose, half_widths
from rigd.analysis.validation.saved_models import SavedModel, read_models
from rigd.config.loader import load_rig
from rigd.dry_run import dry_run
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure, parse_procedure
from rigd_analyses.lugre.design.design import PREPARED_S, subject_of
from rigd_analyses.lugre.design.design import design as lugre_design
from rigd_analyses.lugre.design.motion import Limits, Sensors, refusal
from rigd_analyses.lugre.design.procedure import written
from rigd_analyses.lugre.design.shapes import Kind, Shape, shapes
from rigd_analyses.lugre.design.subject import Subject, obtained
from rigd_analyses.lugre.reading import known_constants
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig import sensors as rows
from rigd_analyses.lugre.rig.sensors import CURRENT_NOISE
from rigd_analyses.lugre.rig.system import MASS

#: Of the simulated rig (configs/plants/lugre.yaml).
SENSORS = Sensors(1e-3, 6e-3, 3.03e-4, 3.07e-5, 0.03, 7.5, 0.1867)
LIMITS = Limits(-0.02, 1.6, 2.0)
HOLD = Kind.HOLD.value
CONSTANT = tuple(Shape(HOLD, current, 1.15) for current in (0.3, 0.6, 0.9))
OTHERS = (
    *(Shape(Kind.SWING.value, 1.5, 1.15, 3.0, frequency_hz=f) for f in (1.2, 3.0)),
    Shape(Kind.CHANGE.value, 0.6, 1.15, 1.0, -0.9, 0.46),
    Shape(Kind.RAMP.value, 0.45, 1.15, 1.5, 1.5),
)


@pytest.fixture(scope="module")
def subject() -> Subject:
    return _subject(LIMITS)


def test_predicted_duration_is_that_of_dry_run(subject: Subject) -> None:
    rig = load_rig("lugre-1")
    picked = [Shape(HOLD, 0.45, 1.15), *OTHERS]
    compiled = compile_procedure(_procedure(picked), rig, {"floor": "pvc"})
    played = dry_run(compiled, rig, 1)
    assert not played.refusals
    predicted = sum(subject.motion(shape).duration_s for shape in picked)
    assert played.duration_s == pytest.approx(predicted + PREPARED_S, rel=0.03)


def test_predicted_current_keeps_to_voltage_line(subject: Subject) -> None:
    motion = subject.motion(Shape(HOLD, 1.5, 1.15))
    turning = motion.states[:, kernel.WHEEL_SPEED]
    least = np.minimum(1.5, 7.5 - 0.1867 * turning)
    driven = slice(501, None)
    assert np.min(motion.current_a[driven]) < 0.7
    assert motion.current_a[driven] == pytest.approx(least[driven], abs=5e-3)


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        (LIMITS, ""),
        (Limits(-0.02, 1.15, 2.0), "beyond the limits of the travel"),
        (Limits(-0.02, 1.6, 1.0), "faster than any recording"),
    ],
)
def test_motion_beyond_a_limit_is_refused(subject: Subject, limits: Limits, reason: str) -> None:
    assert refusal(subject.motion(Shape(HOLD, 0.9, 1.15)), limits) == reason


def test_current_below_break_away_is_no_test(subject: Subject) -> None:
    assert refusal(subject.motion(Shape(HOLD, 0.1, 1.15)), LIMITS) == "it hardly moves"


def test_information_predicts_interval_of_estimator(subject: Subject) -> None:
    picked = [*CONSTANT, *OTHERS]
    outcome = subject.predicted(picked, lambda _: None)
    tests = [subject.offered(shape, subject.motion(shape)) for shape in picked]
    known = _known(subject)
    total = known + sum(test.information for test in tests)
    for name in ("V_s", "mu_s", "sigma_0", "sigma_1", "sigma_2", "g@5mm/s", "g@50mm/s"):
        width = half_widths(total, [subject.target(name, 0, known.shape[-1])])[0]
        assert obtained(outcome, name) == pytest.approx(width, rel=0.25), name


def test_chosen_tests_beat_constant_currents_in_equal_time(subject: Subject) -> None:
    offered = [subject.offered(shape, subject.motion(shape)) for shape in (*CONSTANT, *OTHERS)]
    known = _known(subject)
    targets = [
        subject.target(name, 0, known.shape[-1])
        for name in ("V_s", "mu_s", "sigma_1", "g@5mm/s", "g@50mm/s")
    ]
    constant = offered[: len(CONSTANT)]
    seconds = 3.0 * sum(test.duration_s for test in constant)
    before = half_widths(known + 3.0 * sum(test.information for test in constant), targets)
    after = choose(offered, known, targets, seconds)
    assert after.duration_s <= seconds
    assert np.all(after.half_widths < before)


def test_every_shape_makes_a_procedure_that_compiles() -> None:
    picked = shapes(1.5, 1.15)
    compiled = compile_procedure(_procedure(picked), load_rig("lugre-1"), {"floor": "stone"})
    assert [trial.parameters["current"] for trial in compiled.trials] == pytest.approx(
        [shape.current_a for shape in sorted(picked)]
    )


@pytest.mark.parametrize(
    ("groups", "floor"), [(("pvc",), "pvc"), (("pvc", "stone"), "stone"), (("ice",), "stone")]
)
def test_a_single_designed_floor_becomes_the_default(groups: tuple[str, ...], floor: str) -> None:
    compiled = compile_procedure(_procedure(CONSTANT, *groups), load_rig("lugre-1"), {})
    assert {trial.parameters["floor"] for trial in compiled.trials} == {floor}


def test_line_ends_part_no_quantity_from_its_unit() -> None:
    lines = _procedure(shapes(1.5, 1.15)).file.text.splitlines()
    assert not [line for line in lines if line.endswith(" ")]
    assert not [line for line in lines if line.lstrip().startswith(("A,", "m,", "s,", "Hz,"))]
    assert max(map(len, lines)) < 120


def test_step_that_drives_is_missing() -> None:
    base = load_procedure("constant_current")
    signals = {"motor_current": "other.current", "carriage_position": "carriage.position"}
    with pytest.raises(ConfigError, match=r"no step that sets other\.current"):
        written(base.file.text, "designed", "Title", "Doc.\n", CONSTANT, signals, ["pvc"])


@pytest.mark.parametrize(
    ("change", "targets", "minutes", "message"),
    [
        ({}, (), 0.0, "must be above 0"),
        ({}, (), 0.02, "no test fits"),
        ({}, ("mu_x",), 1.0, "there is no such target"),
        ({}, ("g@50mm",), 1.0, "there is no such target"),
        ({"settings": {}}, (), 1.0, "not identified by output error"),
        ({"settings": {CURRENT_NOISE: 6e-3}}, (), 1.0, "lacks 'fitted drive_gain'"),
        ({"names": ["sigma_0"]}, (), 1.0, "designed for the law lugre alone"),
        ({"model": "approach-angle"}, (), 1.0, "has no design of tests"),
        ({"model": "lugre-lateral"}, (), 1.0, "has no design of tests"),
    ],
)
def test_what_cannot_be_designed_is_refused(
    tmp_path: Path, change: dict[str, Any], targets: tuple[str, ...], minutes: float, message: str
) -> None:
    model = saved_model(tmp_path, **change)
    base = load_procedure("constant_current")
    with pytest.raises((ConfigError, DataError), match=message):
        design(model, load_rig("lugre-1"), base, minutes, targets, "designed")


def test_model_without_fitted_mass_takes_stated_one(tmp_path: Path) -> None:
    old = {rows.FITTED + name: x for name, x in fitted_constants().items() if name != "mass"}
    (saved,) = read_models(saved_model(tmp_path, settings={**SENSOR_ROWS, **old}))
    assert subject_of(_ground(saved)).shared[MASS] == 4.2


def test_model_of_another_mass_is_refused(tmp_path: Path) -> None:
    (saved,) = read_models(saved_model(tmp_path))
    with pytest.raises(ConfigError, match=r"of a carriage of 3\.9593 kg, the rig has now 4\.2 kg"):
        subject_of(_ground(saved))


def test_tests_without_sliding_determine_no_friction(subject: Subject) -> None:
    weak = subject.motion(Shape(HOLD, 0.05, 1.15))
    for visited in (subject.visited([weak]), subject.visited([])):
        for name in ("V_s", "mu_c", "mu_s", "g@50mm/s"):
            assert subject.beyond(name, visited) == "the bristle slides in no test"


def test_lower_limit_of_current_leaves_tests_out(tmp_path: Path) -> None:
    (saved,) = read_models(saved_model(tmp_path))
    ground = _ground(saved)
    ground = replace(
        ground,
        constants={**ground.constants, "mass": 3.9593},
        limits={**ground.limits, "motor_current": (0.0, 1.5)},
        trials=({"current": 1.5, "brake_at": 1.15, "longest_drive": 4.0},),
    )
    request = DesignRequest((ground,), 2.0, (), "", "base", {}, "designed")
    with pytest.raises(DataError, match="no test fits: of 24, "):
        lugre_design(request, lambda _: None)


def test_lowest_current_is_that_of_phases() -> None:
    at = np.linspace(0.0, 1.5, 200)
    for shape in shapes(1.5, 1.15):
        told = [phase.current(at[at < phase.lasting_s]) for phase in shape.phases]
        lowest = min(0.0, *(float(np.min(values)) for values in told))
        assert min(0.0, shape.lowest_a) == pytest.approx(lowest), shape


def test_travel_beyond_two_metres_is_within_bounds() -> None:
    text = _procedure([Shape(HOLD, 0.6, 2.5)]).file.text
    assert text.count("max: 2.5 m") == 2


def _ground(saved: SavedModel) -> Ground:
    plan = compile_procedure(
        load_procedure("constant_current"), load_rig("lugre-1"), {"floor": "pvc"}
    ).identify
    assert plan is not None
    values = {name: value for name, value in plan.constants.items() if not isinstance(value, str)}
    limits = {"carriage_position": (-0.02, 1.6)}
    return Ground(saved, {**values, "mass": 4.2}, {}, limits, ())


def _subject(limits: Limits) -> Subject:
    plan = compile_procedure(
        load_procedure("constant_current"), load_rig("lugre-1"), {"floor": "pvc"}
    ).identify
    assert plan is not None
    values = {name: value for name, value in plan.constants.items() if not isinstance(value, str)}
    stated = {name: u.of(values[name]) for name, u in plan.uncertainties.items()}
    constants = known_constants(values, stated)
    return Subject("pvc", _shared(), SENSORS, constants, limits)


def _shared() -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.append(PVC, list(fitted_constants().values()))


def _known(subject: Subject) -> np.ndarray[Any, np.dtype[np.float64]]:
    shape = CONSTANT[-1]
    return subject.known(subject.system([shape], [subject.motion(shape)]))


def _procedure(picked: Any, *groups: str) -> Any:
    base = load_procedure("constant_current")
    plan = compile_procedure(base, load_rig("lugre-1"), {}).identify
    assert plan is not None
    text = written(base.file.text, "designed", "Title", "Doc.\n", picked, plan.signals, groups)
    return parse_procedure(text, Path("designed.yaml"))
