"""Brings the robot to output error: motor speeds in; motor torques and camera poses out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.homogeneity import TrialParts, homogeneity
from rigd.analysis.output_error.pipeline import Family
from rigd.analysis.output_error.structure import Suspect
from rigd.analysis.output_error.system import System
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import FitOutcome, FloatArray, Gate, ResidualTest
from rigd_analyses.articulated.extensions import candidates
from rigd_analyses.articulated.search import SCORES, RobotFit
from rigd_analyses.articulated.system import SHARED, RobotSystem
from rigd_analyses.articulated.thresholds import ROBOT

LENGTHS: Final = ("wheel_radius", "half_track", "half_wheelbase", "hinge_distance")


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotFamily(Family[RobotSystem]):
    """The robot: the fit of all its trials, and ``grip``, the share that certainly grips."""

    found: RobotFit
    grip: float

    def fitted(self) -> OutputErrorFit:
        """Return the fit of all trials, in two stages."""
        return self.found.whole

    def elsewhere(self) -> tuple[FloatArray, ...]:
        """Return nothing: the search of the robot has been at other starts."""
        return ()

    def refitted(self, system: System, starts: Sequence[FloatArray], block: int) -> OutputErrorFit:
        """Return the fit of a system with something added, from the first of ``starts`` (p,)."""
        return self.found.refitted(system, starts, block)

    def suspects(self, theta: FloatArray) -> Iterator[Suspect]:
        """Return what may be wrong with robot, contacts and camera."""
        return candidates(self.system, theta)

    def agreement(self, whole: OutputErrorFit, gate: Gate) -> tuple[ResidualTest, ...]:
        """Return the tests whether trials and recordings have one k_lon, which all motion shows."""
        parts = TrialParts(
            "recordings", [item.recording for item in self.system.trials],
            "Something changed between them; identify each by a command of its own.",
        )  # fmt: skip
        stiffness = SHARED.index("k_lon")
        return homogeneity(whole, stiffness, "longitudinal stiffness", [parts], self.block)

    def findings(self, whole: OutputErrorFit, gate: Gate, tests: tuple[ResidualTest, ...]) -> Gate:
        """Return ``gate`` with a torque that is off, and a scale that all lengths share."""
        gate = with_torques(gate, whole, self.system, self.labels, ("right", "left"))
        return with_lengths(gate, whole)

    def shifts(self, whole: OutputErrorFit) -> tuple[FloatArray, ...]:
        """Return the step of the parameters if all lengths are off instead of the camera."""
        return by_lengths(whole, LENGTHS)


def robot_family(found: RobotFit, grip: float) -> RobotFamily:
    """Return a fit of the robot for the pipeline of output error."""
    trials = found.system.trials
    return RobotFamily(
        system=found.system,
        labels=tuple(item.label for item in trials),
        period_s=trials[0].period_s,
        block=SCORES,
        found=found,
        grip=grip,
    )


def common_scale(found: OutputErrorFit) -> float:
    """Return by which share the camera shows all ways longer than the stated lengths have them.

    The better known axis counts for more: a robot that drives along x shows little of y. It is 0 if
    chance may show as much.
    """
    places = [_names(found).index(f"scale_{axis}") for axis in "xy"]
    covariance = found.covariance[np.ix_(places, places)]
    variances = np.diag(covariance)
    weights = np.divide(1.0, variances, out=np.zeros(2), where=variances > 0.0)
    weights /= max(float(np.sum(weights)), np.finfo(float).tiny)
    off = float(weights @ found.fit.theta[places])
    return off if abs(off) > Z_95 * math.sqrt(float(weights @ covariance @ weights)) else 0.0


def by_lengths(found: OutputErrorFit, lengths: Sequence[str]) -> tuple[FloatArray, ...]:
    """Return the step (p,) of the parameters if all ``lengths`` are off, not the camera's scale.

    All lengths move by what the camera shows; of the others, only the data and what is stated of
    them decide. There is none if the camera shows the ways as they are.
    """
    off = common_scale(found)
    if abs(off) <= ROBOT.max_length_share:
        return ()
    known = found.model.known.rows
    information = found.information + known.T @ known
    moved = np.zeros(len(information))
    places = np.array([_names(found).index(name) for name in lengths])
    moved[places] = math.log1p(off)
    others = np.setdiff1d(np.flatnonzero(np.diag(information) > 0.0), places)
    slope = information[np.ix_(others, places)] @ moved[places]
    moved[others] = -scaled_pinv(information[np.ix_(others, others)]) @ slope
    return (moved,)


def _names(found: OutputErrorFit) -> list[str]:
    return [item.parameter.name for item in found.model.system.shared]


def with_lengths(gate: Gate, found: OutputErrorFit) -> Gate:
    """Return the gate with the finding that all lengths may be off; fits are corrected."""
    off = common_scale(found)
    if abs(off) <= ROBOT.max_length_share:
        return gate
    text = (
        f"the camera shows all ways {100 * off:+.1f} % off what the lengths of the rig file give: "
        "its unit of length, or all of these lengths. The intervals hold for both."
    )
    if gate.outcome is FitOutcome.FITS:
        outcome = FitOutcome.CORRECTED
        return replace(gate, outcome=outcome, sentence=f"The model fits these data, but {text}",
                       findings=(text,))  # fmt: skip
    return replace(gate, findings=(*gate.findings[:1], text, *gate.findings[1:]))


class HasTorques(Protocol):
    """A system whose first outputs are torques, which count at some frames only."""

    def torque_counts(self, trial: int) -> NDArray[np.bool_]:
        """Return at which frames (n,) of one trial a torque counts."""


def with_torques(
    gate: Gate, found: OutputErrorFit, system: HasTorques, labels: Sequence[str],
    motors: Sequence[str],
) -> Gate:  # fmt: skip
    """Return the gate, a misfit if the torque of one of the ``motors`` is off."""
    loud = _loud_torque(found, system, labels, motors)
    if not loud or gate.outcome is FitOutcome.MISFIT:
        return gate
    text = f"The model does not fit these data: {loud}"
    findings = (loud, *gate.findings)
    return replace(gate, outcome=FitOutcome.MISFIT, sentence=text, findings=findings)


def _loud_torque(
    found: OutputErrorFit, system: HasTorques, labels: Sequence[str], motors: Sequence[str]
) -> str:
    """Return which torque is off; empty if none is. Most frames hold none, and hide a misfit."""
    squares, count = [], len(motors)
    for k, (noise, error) in enumerate(zip(found.model.noise, found.errors, strict=True)):
        squares.append(noise.whiten_errors(error)[system.torque_counts(k), :count] ** 2)
    if not any(len(part) for part in squares):
        return ""
    together = np.mean(np.concatenate(squares), axis=0)
    none = [0.0] * count
    by_trial = np.array([np.mean(part, axis=0) if len(part) else none for part in squares])
    for index, motor in enumerate(motors):
        worst = int(np.argmax(by_trial[:, index]))
        if together[index] > THRESHOLDS.max_mean_square_output:
            return (
                f"its {motor} torque is off by {together[index] ** 0.5:.1f} times what the noise "
                f"of the sensors leaves, by {by_trial[worst, index] ** 0.5:.1f} times in trial "
                f"{labels[worst]}."
            )
    return ""
