"""Method A behind the gate of the simulated rig: the numbers that a user has by default."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.lugre.wrong import World, right

from rigd.analysis.result import FitOutcome, Gate, IdentificationResult, ResidualTest, Verdict
from rigd_analyses.lugre.rig.family import RigFit, fit_group
from rigd_analyses.lugre.slip_force.identify import Settings, identify_lugre
from rigd_analyses.lugre.slip_force_check import checked

FEW = tuple(((amps, 2.0),) for amps in (0.45, 0.75, 1.05, 1.35))
SETTINGS = Settings(starts=2)


def both(world: World) -> tuple[IdentificationResult, RigFit]:
    """Return what method A finds, and the fit of output error that its gate stands on."""
    trials = replace(world, program=FEW).trials(1)
    alone = identify_lugre(trials, world.constants, SETTINGS)
    return alone, fit_group(trials, world.constants, world.rig, SETTINGS)


def found(world: World) -> tuple[IdentificationResult, IdentificationResult]:
    """Return what method A finds alone, and behind the gate."""
    alone, begun = both(world)
    return alone, checked(alone, begun)


@pytest.fixture(scope="module")
def of_right_rig() -> tuple[IdentificationResult, RigFit]:
    return both(right("pvc"))


def test_right_rig_keeps_numbers_of_method_a(
    of_right_rig: tuple[IdentificationResult, RigFit],
) -> None:
    alone, held = of_right_rig[0], checked(*of_right_rig)
    assert held.gate is not None
    assert held.gate.outcome is FitOutcome.FITS
    assert held.parameter("sigma_0").identifiable
    assert held.parameter("sigma_0") == alone.parameter("sigma_0")
    assert all(held.curve.low <= alone.curve.low)


def assert_no_number(alone: IdentificationResult, held: IdentificationResult) -> None:
    """Assert that the gate has closed on numbers that method A has alone."""
    assert any(item.identifiable for item in alone.parameters)
    assert held.gate is not None
    assert held.gate.outcome is FitOutcome.MISFIT
    assert {item.verdict for item in held.parameters} == {Verdict.MISFIT}
    assert not held.derived
    assert held.curve.x.size == 0
    assert held.point is None
    assert held.warnings[0] == held.gate.sentence


def test_misfit_leaves_no_number_of_method_a(
    of_right_rig: tuple[IdentificationResult, RigFit],
) -> None:
    alone, begun = of_right_rig
    misfit = replace(begun, gate=Gate(FitOutcome.MISFIT, "It does not fit.", ("first", "second")))
    held = checked(alone, misfit)
    assert_no_number(alone, held)
    assert held.warnings[1] == "second"


def test_another_law_leaves_no_number_of_method_a() -> None:
    world = right("pvc")
    world = replace(world, physics=world.physics._replace(exponent=1.0))
    assert_no_number(*found(world))


def test_number_that_output_error_contradicts_is_withdrawn() -> None:
    """A drag that method A takes for friction, and that output error knows."""
    world = right("pvc")
    world = replace(world, physics=world.physics._replace(drag=0.2))
    alone, held = found(world)
    missed = [
        item for item in alone.parameters
        if item.name in world.truth and item.low is not None and item.high is not None
        and not item.low <= world.truth[item.name] <= item.high
    ]  # fmt: skip
    assert missed, "method A alone is not wrong here"
    for item in missed:
        entry = held.parameter(item.name)
        assert entry.low is None and entry.high is None
        assert entry.verdict is Verdict.UNRESOLVED
        assert "output-error" in entry.sentence


def test_correction_stands_above_other_warnings(
    of_right_rig: tuple[IdentificationResult, RigFit],
) -> None:
    alone, begun = of_right_rig
    gate = Gate(FitOutcome.CORRECTED, "The zero is off.", ("first", "second"))
    alone = replace(alone, warnings=("other",))
    held = checked(alone, replace(begun, gate=gate))
    first = "The zero is off. Slip-force does not correct for it. `--method output-error` gives"
    assert held.warnings[0].startswith(first)
    assert held.warnings[1:] == ("second", "other")
    assert held.parameter("sigma_0").identifiable


def test_fit_that_has_not_converged_leaves_no_number(
    of_right_rig: tuple[IdentificationResult, RigFit],
) -> None:
    alone, begun = of_right_rig
    whole = replace(begun.whole, left=np.full_like(begun.whole.left, 3.0))
    held = checked(alone, replace(begun, whole=whole))
    assert_no_number(alone, held)
    assert "the fit has not converged: V_s has 3 standard errors to go" in held.warnings[0]


def test_change_of_friction_stands_above_other_warnings(
    of_right_rig: tuple[IdentificationResult, RigFit],
) -> None:
    alone, begun = of_right_rig
    rises = ResidualTest("steady friction", 17.0, 4e-5, False, "The friction rises.")
    held = checked(replace(alone, warnings=("other",)), replace(begun, tests=(rises,)))
    assert held.warnings == ("The friction rises.", "other")
    assert held.parameter("sigma_0").identifiable


def test_named_misfit_stands_above_other_warnings() -> None:
    _, held = found(replace(right("pvc"), guide_eccentric=1e-4))
    assert held.gate is not None
    assert held.gate.outcome is FitOutcome.CORRECTED
    assert "Slip-force does not correct for it" in held.warnings[0]
