"""Constants of an identification: values, uncertainties and units, from procedure and rig."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rigd.config.loader import load_rig
from rigd.model import ConfigError
from rigd.model.constants import Uncertainty
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.procedure.program import CompiledProcedure, IdentifyPlan

Compile = Callable[..., CompiledProcedure]
GIVEN = '{mass: "${rig.moving_mass}", rolling_resistance: "${rolling}"}'
DRIVE = (
    "torque_constant", "gear_ratio", "gear_efficiency", "no_load_torque", "no_load_viscous",
    "motor_inertia", "wheel_inertia", "bearing_torque", "roller_transitions",
)  # fmt: skip


@pytest.fixture
def plan_with(compile_text: Compile, small: str) -> Callable[..., IdentifyPlan]:
    def compile_it(constants: str) -> IdentifyPlan:
        plan = compile_text(small.replace(GIVEN, constants)).identify
        assert plan is not None
        return plan

    return compile_it


PlanWith = Callable[..., IdentifyPlan]


@pytest.mark.parametrize(
    ("written", "u", "unit"),
    [
        ("${rig.moving_mass}", Uncertainty(1e-3), "kg"),
        ("{value: '${rig.moving_mass}'}", Uncertainty(1e-3), "kg"),
        ("{value: '${rig.moving_mass}', u: 5 g}", Uncertainty(5e-3), "kg"),
        ("2 * ${rig.moving_mass}", None, "kg"),
        ("{value: 4000 g, u: 1 %}", Uncertainty(0.01, is_share=True), "g"),
        ("4 kg", None, "kg"),
        ("+(4000 g)", None, "g"),
        ("${speed}", None, "mm/s"),
    ],
)
def test_constant_keeps_its_uncertainty_and_unit(
    plan_with: PlanWith, written: str, u: Uncertainty | None, unit: str
) -> None:
    plan = plan_with(f"{{mass: {written if written[0] == '{' else repr(written)}}}")
    assert plan.uncertainties.get("mass") == u
    assert plan.units["mass"] == unit


def test_a_swept_constant_has_the_uncertainty_given(plan_with: PlanWith) -> None:
    plan = plan_with("{load: {value: '${current}', u: 10 %}, pull: '${current}'}")
    assert plan.constants == {"load": "current", "pull": "current"}
    assert plan.uncertainties == {"load": Uncertainty(0.1, is_share=True)}
    assert plan.units == {"load": "A", "pull": "A"}


@pytest.mark.parametrize(
    ("written", "parts"),
    [
        ("{value: '${rig.moving_mass}', u: 1 mm}", ["is in mm, expected kg or %"]),
        ("{value: '${rolling}', u: 1 g}", ["is in g, expected 1 or %"]),
        ("{value: 4 kg, u: -1 g}", ["'-1 g' is below 0"]),
        ("{value: 4 kg, u: '${speed}'}", ["cannot read '${speed}'"]),
        ("{u: 1 g}", ["key 'value' is missing"]),
        ("{value: 4 kg, source: a, why: b}", ["unknown key 'why'"]),
        ("{value: '${floor}', u: 1 %}", ["'stone' is a word"]),
    ],
)
def test_a_wrong_constant_is_refused_at_its_place(
    plan_with: PlanWith, written: str, parts: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        plan_with(f"{{mass: {written}}}")
    assert caught.value.place is not None
    assert all(part in str(caught.value) for part in parts)


@pytest.mark.parametrize(
    "name", ["constant_current", "recommended_identification", "validation_masses"]
)
@pytest.mark.parametrize("rig", ["lugre-1", "card-lugre", "wire-1"])
def test_shipped_procedures_pass_on_the_drive(name: str, rig: str) -> None:
    plan = compile_procedure(load_procedure(name), load_rig(rig)).identify
    assert plan is not None
    known = {name: plan.uncertainties[name].of(float(plan.constants[name])) for name in DRIVE}
    assert known["gear_ratio"] == known["roller_transitions"] == 0
    assert known["torque_constant"] == pytest.approx(0.01 * 29.5e-3)


def with_reference(small: str, reference: str) -> str:
    return small.replace("  group_by: floor\n", f"  group_by: floor\n  reference: {reference}\n")


def test_reference_without_choices_holds_for_all(compile_text: Compile, small: str) -> None:
    text = with_reference(small, "{label: Table 2, parameters: {mu_s: 0.9, sigma_0: 12 1/m}}")
    plan = compile_text(text).identify
    assert plan is not None
    assert plan.reference == {"mu_s": 0.9, "sigma_0": 12.0}
    assert plan.reference_label == "Table 2"


@pytest.mark.parametrize(
    ("reference", "part"),
    [
        ("{label: A}", "without 'by', a reference has 'parameters' and no 'values'"),
        ("{label: A, by: floor}", "with 'by', a reference has 'values' and no 'parameters'"),
        ("{label: A, by: floor, values: {pvc: {mu_s: 1}}, parameters: {mu_s: 1}}", "with 'by'"),
        ("{label: A, parameters: {mu_s: '${floor}'}}", "stone"),
    ],
)
def test_reference_of_both_kinds_is_refused(
    compile_text: Compile, small: str, reference: str, part: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        compile_text(with_reference(small, reference))
    assert part in str(caught.value)
    assert caught.value.place is not None


def test_optional_signal_needs_rig_that_has_it(compile_text: Compile, small: str) -> None:
    old = f"  constants: {GIVEN}\n"
    assert small.count(old) == 1
    named = "{angle: wheel_encoder.angle, heat: oven.temperature}"
    plan = compile_text(small.replace(old, f"  optional_signals: {named}\n{old}")).identify
    assert plan is not None
    assert plan.signals["angle"] == "wheel_encoder.angle"
    assert "heat" not in plan.signals
