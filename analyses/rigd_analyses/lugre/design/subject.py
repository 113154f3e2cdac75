"""Holds what a design knows of one floor: its model, the rig's constants, sensors and limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigd.analysis import parse_quantity
from rigd.analysis.design.optimal import DesignTarget, PossibleTest
from rigd.analysis.fitting.model import scaled_bounds, slopes
from rigd.analysis.output_error.pipeline import DiagnosedFit
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import FitOutcome, FloatArray, Gate, IdentificationResult
from rigd_analyses.lugre.curve import SLIDING, slid_range
from rigd_analyses.lugre.design.motion import Limits, Motion, Sensors, predict, reading
from rigd_analyses.lugre.design.shapes import Shape
from rigd_analyses.lugre.model import PARAMETERS, V_S, friction, friction_gradient
from rigd_analyses.lugre.quantities import BY_COVARIANCE, COULOMB, STATIC, STRIBECK_SPEED
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.family import RigFamily, family_of, rig_system, with_intervals
from rigd_analyses.lugre.rig.parts import free_part
from rigd_analyses.lugre.rig.result import result
from rigd_analyses.lugre.rig.standard_errors import FRICTION
from rigd_analyses.lugre.rig.system import RigSystem
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import RigConstants

QUANTITIES = {item.name: item for item in (STRIBECK_SPEED, COULOMB, STATIC, *BY_COVARIANCE)}
SEED = 1  #: of the noise of predicted recordings


@dataclass(frozen=True, eq=False)
class Subject:
    """One group of the model file.

    ``shared`` (26,) are friction and constants as they were fitted, around which is predicted;
    ``constants`` are those that the next identification begins from. ``other`` is friction that the
    model's data accept as well, far from its point, if they leave V_s open.
    """

    name: str
    shared: FloatArray
    sensors: Sensors
    constants: RigConstants
    limits: Limits
    other: FloatArray | None = None

    @property
    def possible(self) -> tuple[Subject, ...]:
        """The subject, and that with the other friction that its data accept."""
        if self.other is None:
            return (self,)
        shared = np.append(self.other, self.shared[FRICTION:])
        return (self, replace(self, shared=shared, other=None))

    @property
    def theta(self) -> FloatArray:
        """The parameters (6,) of friction."""
        return self.shared[:FRICTION]

    def motion(self, shape: Shape) -> Motion:
        """Return the predicted motion of a test."""
        return predict(shape, self.shared, self.constants, self.sensors)

    def offered(self, shape: Shape, motion: Motion) -> PossibleTest:
        """Return what a test adds to the information of output error, (1, 26, 26) scaled."""
        system = self.system([shape], [motion])
        shared = self.shared
        theta = np.append(shared, np.zeros(len(system.local)))
        model = OutputErrorModel(system, noise_at(system, theta))
        scale = slopes(model.parameters, theta)
        whole = model.normal_equations(theta).information * np.outer(scale, scale)
        whole -= np.diag(np.append(model.precision[: len(shared)], np.zeros(len(system.local))))
        split = len(shared)
        own, mixed = whole[split:, split:], whole[:split, split:]
        information = whole[:split, :split] - mixed @ np.linalg.solve(own, mixed.T)
        return PossibleTest(information[None], motion.duration_s)

    def known(self, system: RigSystem) -> FloatArray:
        """Return the information (1, 26, 26) before any test: constants, and the box of a law."""
        low, high = scaled_bounds(PARAMETERS)
        box = (high - low) / math.sqrt(12.0)
        u = [item.u for item in system.shared[FRICTION:]]
        return np.diag(1.0 / np.append(box, u) ** 2)[None]

    def family(self, shapes: Sequence[Shape], motions: Sequence[Motion]) -> RigFamily:
        """Return predicted recordings for the pipeline of output error."""
        trials = [
            reading(motion, shape, self.sensors, SEED + k, f"test {k + 1}")
            for k, (shape, motion) in enumerate(zip(shapes, motions, strict=True))
        ]
        settings = Settings()
        parts = [(trial, free_part(trial, self.sensors.period_s, settings)) for trial in trials]
        return family_of(rig_system(parts, self.constants, self.theta), parts, (self.shared,))

    def system(self, shapes: Sequence[Shape], motions: Sequence[Motion]) -> RigSystem:
        """Return the system of predicted recordings."""
        return self.family(shapes, motions).system

    def predicted(
        self, shapes: Sequence[Shape], notify: Callable[[str], None]
    ) -> IdentificationResult:
        """Return what the estimator makes of predicted recordings of these tests."""
        motions = {shape: self.motion(shape) for shape in set(shapes)}
        family = self.family(shapes, [motions[shape] for shape in shapes])
        notify(f"{self.name}: the intervals of {len(shapes)} tests, from predicted recordings")
        gate = Gate(FitOutcome.FITS, "Predicted recordings.")
        return result(with_intervals(DiagnosedFit(family, family.fitted(), gate)))

    def target(self, name: str, group: int, size: int) -> DesignTarget:
        """Return a target by its name: a parameter, or g at a slip, such as ``g@50mm/s``."""
        speed = slip_of(name)
        if speed is None:
            quantity = QUANTITIES[name]
            by_log = quantity.log_gradient(self.theta)[0]
        else:
            at = np.array([speed])
            by_log = friction_gradient(self.theta, at)[0] / friction(self.theta, at)[0]
        gradient = np.zeros(size)
        gradient[:FRICTION] = by_log * slopes(PARAMETERS, self.theta)
        other = 0.0 if name == STRIBECK_SPEED.name else self.constants.weight_u
        return DesignTarget(name, group, gradient, other)

    def slip(self, motion: Motion) -> FloatArray:
        """Return the slip (n,) in m/s of the samples in which the bristle slides."""
        states, radius = motion.states, self.shared[kernel.NAMES.index("wheel_radius")]
        slip = np.abs(radius * states[:, kernel.WHEEL_SPEED] - states[:, kernel.SPEED])
        bent = np.abs(states[:, kernel.BRISTLE]) >= SLIDING * friction(self.theta, slip)
        return np.asarray(slip[bent])

    def visited(self, motions: Sequence[Motion]) -> tuple[float, float]:
        """Return the range of slip in m/s that the estimator takes as visited.

        It is empty, from inf to 0, if the bristle slides in none of ``motions``.
        """
        slip = np.concatenate([np.empty(0), *(self.slip(motion) for motion in motions)])
        return slid_range(slip, self.theta, self.sensors.period_s) or (math.inf, 0.0)

    def beyond(self, name: str, visited: tuple[float, float]) -> str:
        """Return why no test with this slip gives a target; empty if one may."""
        low, high = visited
        if low > high:
            return "the bristle slides in no test"
        speed, slip = float(self.theta[V_S]), slip_of(name)
        if slip is not None:
            inside = low <= slip <= high
            return "" if inside else f"the slip is {1e3 * low:.2g} to {1e3 * high:.0f} mm/s"
        if name in ("V_s", "mu_c") and speed > high:
            return f"V_s is {speed:.2g} m/s, the slip reaches {high:.2g} m/s"
        if name in ("V_s", "mu_s") and speed < low:
            return f"V_s is {speed:.2g} m/s, the slip begins at {low:.2g} m/s"
        return ""


def slip_of(name: str) -> float | None:
    """Return the slip in m/s of a target such as ``g@50mm/s``; None of a parameter."""
    if not name.startswith("g@"):
        return None
    return parse_quantity(name[2:]).value


def obtained(outcome: IdentificationResult, name: str) -> float | None:
    """Return the relative half width of a target in a result; None if its interval is open."""
    slip = slip_of(name)
    if slip is None:
        entry = outcome.parameter(name)
        if entry.low is None or entry.high is None:
            return None
        return (entry.high - entry.low) / (2.0 * entry.estimate)
    curve = outcome.curve
    if not len(curve.x) or not curve.x[0] <= slip <= curve.x[-1]:
        return None
    low, mid, high = (float(np.interp(slip, curve.x, y)) for y in (curve.low, curve.y, curve.high))
    return (high - low) / (2.0 * mid)
