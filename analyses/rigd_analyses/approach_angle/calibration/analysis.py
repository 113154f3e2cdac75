"""Declares the five calibrations of the approach-angle rig to rigd: what they need and measure."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Needs, Options
from rigd_analyses.approach_angle.values import CALIBRATABLE, SIGNALS

if TYPE_CHECKING:
    from rigd.analysis.calibration.reading import Steps
    from rigd.analysis.calibration.result import CalibrationResult
    from rigd.analysis.recordings.source import RecordedSweep


def _signals(*names: str) -> dict[str, str]:
    return {name: SIGNALS[name] for name in names}


class _Calibration(Analysis):
    """One recording gives calibrated values; several are refused."""

    calibratable = CALIBRATABLE
    options = ("calibration",)

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return what the recording of a calibration gives; refused results give the reason."""
        from rigd.analysis.calibration.evaluation import evaluated
        from rigd.analysis.calibration.reading import steps_of

        steps = steps_of(sweeps, options.calibration)
        notify(f"{steps.sweep.plan.model} of {steps.sweep.path.name}")
        return evaluated(steps, self.result(steps))

    @abstractmethod
    def result(self, steps: Steps) -> CalibrationResult:
        """Return the values that the steps of the recording give, or why they do not."""


class TorqueCalibration(_Calibration):
    """Torque per volt of the gauges: weights on the arm of the clamped shaft."""

    needs = Needs(
        signals=_signals("gauge_a", "gauge_b"),
        constants=(
            "arm",
            "arm_uncertainty",
            "mass_uncertainty",
            "gravity",
            "gravity_uncertainty",
            "alignment_uncertainty",
            "poisson",
        ),
        constant_units={
            **{"arm": "m", "arm_uncertainty": "m", "mass_uncertainty": "1", "poisson": "1"},
            **{"gravity": "m/s^2", "gravity_uncertainty": "m/s^2", "alignment_uncertainty": "rad"},
        },
        trial_parameters=("mass",),
    )
    measures = ("torque_scale",)

    def result(self, steps: Steps) -> CalibrationResult:
        """Return the torque scale."""
        from rigd_analyses.approach_angle.calibration.reading import torque_result

        return torque_result(steps)


class ScaleCalibration(_Calibration):
    """True load per load that the scale shows: known weights on it."""

    needs = Needs(
        signals=_signals("load"),
        constants=("weight_uncertainty", "division"),
        constant_units={"weight_uncertainty": "1", "division": "kg"},
        trial_parameters=("weight",),
    )
    measures = ("load_scale",)

    def result(self, steps: Steps) -> CalibrationResult:
        """Return the load scale."""
        from rigd_analyses.approach_angle.calibration.reading import scale_result

        return scale_result(steps)


class LoadCellCalibration(_Calibration):
    """Normal force per volt of the fast load cell: loads of the wheel, as the scale shows them."""

    needs = Needs(
        signals=_signals("normal_force", "load"),
        constants=("division", "gravity"),
        constant_units={"division": "kg", "gravity": "m/s^2"},
        trial_parameters=("load",),
        calibrated=("load_scale",),
    )
    measures = ("normal_force_scale", "normal_force_zero")

    def result(self, steps: Steps) -> CalibrationResult:
        """Return the scale and the zero of the load cell."""
        from rigd_analyses.approach_angle.calibration.reading import cell_result

        return cell_result(steps)


class FrictionCalibration(_Calibration):
    """Friction of rails and bearings: the platform coasts, the lifted wheel spins."""

    needs = Needs(
        signals=_signals("gauge_a", "gauge_b", "wheel_angle", "platform_position"),
        constants=("platform_mass", "platform_mass_uncertainty", "gravity", "wheel_inertia"),
        constant_units={
            **{"platform_mass": "kg", "platform_mass_uncertainty": "1"},
            **{"gravity": "m/s^2", "wheel_inertia": "kg m^2"},
        },
        trial_parameters=("test",),
        calibrated=("torque_scale", "wheel_scale", "platform_scale", "rail_load"),
    )
    measures = ("bearing_constant", "bearing_viscous", "rail_constant", "rail_viscous")

    def result(self, steps: Steps) -> CalibrationResult:
        """Return the rails and bearings that the recording determines."""
        from rigd_analyses.approach_angle.calibration.reading import friction_result

        return friction_result(steps)


class RiseCalibration(_Calibration):
    """Rise of the load along the travel: the loaded platform is pushed to its end and back."""

    needs = Needs(
        signals=_signals("load", "platform_position"),
        constants=("division",),
        constant_units={"division": "kg"},
        trial_parameters=("load",),
        calibrated=("platform_scale",),
    )
    measures = ("load_rise",)

    def result(self, steps: Steps) -> CalibrationResult:
        """Return the rise of the load."""
        from rigd_analyses.approach_angle.calibration.reading import rise_result

        return rise_result(steps)
