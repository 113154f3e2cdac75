"""Compares measured with modelled carriage speeds, with and without the modelled lateral force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from rigd.analysis.output_error.augmented_system import own_parameters
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.constants import LateralTrial
from rigd_analyses.lugre.lateral.speeds.published_cells import Published, published
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.lateral.thresholds import LATERAL
from rigd_analyses.lugre.rig.outputs import TRAVEL
from rigd_analyses.lugre.rig.system import LEAD

WINDOW_S = 0.031  #: of the filter that makes speeds of positions, measured and modelled alike
ORDER = 2


@dataclass(frozen=True, eq=False)
class Speeds:
    """Carriage speed of one trial in m/s from shortly before the current step on, (n,)."""

    t_s: FloatArray
    measured: FloatArray
    ignored: FloatArray
    included: FloatArray


@dataclass(frozen=True)
class Cell:
    """One trial: RMS of measured minus modelled speed in m/s, lateral force ignored and included.

    ``lateral_speed_m_s`` has the measured sign. ``error_ignored_m_s`` is the mean of the error at
    the end of the drive: above zero, the carriage is faster than the model that ignores.
    """

    label: str
    current_a: float
    lateral_speed_m_s: float
    ignored_m_s: float
    included_m_s: float
    error_ignored_m_s: float
    published: Published | None

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "label": self.label,
            "current_A": self.current_a,
            "lateral_speed_m_s": self.lateral_speed_m_s,
            "rms_ignored_m_s": self.ignored_m_s,
            "rms_included_m_s": self.included_m_s,
            "final_error_ignored_m_s": self.error_ignored_m_s,
            "paper": self.published,
        }


@dataclass(frozen=True)
class Together:
    """Root mean square over trials of their RMS speed error, m/s; ``paper`` over its own cells."""

    name: str
    trials: int
    ignored_m_s: float
    included_m_s: float
    error_ignored_m_s: float
    paper: Published | None

    @property
    def ratio(self) -> float:
        """Return ignored over included."""
        return self.ignored_m_s / self.included_m_s if self.included_m_s > 0.0 else np.inf

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "trials": self.trials,
            "rms_ignored_m_s": self.ignored_m_s,
            "rms_included_m_s": self.included_m_s,
            "ratio": self.ratio,
            "final_error_ignored_m_s": self.error_ignored_m_s,
            "paper": self.paper,
        }


def speeds(system: LateralSystem, shared: FloatArray, local: FloatArray, trial: int) -> Speeds:
    """Return the speeds of one trial; parameters (p,) and (l,) in natural units."""
    driven = system.rig.trials[trial]
    window = round(WINDOW_S / system.rig.period_s) | 1
    # A drive can be shorter than the filter.
    window = min(window, len(driven.measured) - 1 + len(driven.measured) % 2)

    def rate(position: FloatArray) -> FloatArray:
        return np.asarray(
            savgol_filter(position, window, ORDER, deriv=1, delta=system.rig.period_s)
        )

    return Speeds(
        driven.trial.t_s[driven.part],
        rate(driven.measured[:, TRAVEL]),
        rate(system.ignoring(trial, shared, local)[:, TRAVEL]),
        rate(system.simulate(trial, shared, local)[:, TRAVEL]),
    )


def lacking_force(error_m_s: FloatArray, system: LateralSystem, trial: int) -> float:
    """Return the constant force in the direction of motion, in N, that explains a speed error (n,).

    It is the slope of the error over the drive times what is moved, m_T + I / r^2.
    """
    error, known = error_m_s[LEAD:], system.rig.constants
    t = (np.arange(len(error)) - 0.5 * (len(error) - 1)) * system.rig.period_s
    moved = known.mass.value + known.inertia.value / known.wheel_radius.value**2
    return float(system.direction(trial) * moved * (t @ error) / (t @ t))


def all_speeds(system: LateralSystem, whole: OutputErrorFit) -> list[Speeds]:
    """Return the speeds of every trial with the fitted parameters."""
    count, theta = len(system.shared), own_parameters(whole)
    local = theta[count:].reshape(len(system.speeds), -1)
    return [speeds(system, theta[:count], own, k) for k, own in enumerate(local)]


def cell(trial: LateralTrial, lateral_m_s: float, found: Speeds) -> Cell:
    """Return the errors of one trial, whose mean measured lateral speed is ``lateral_m_s``."""
    ignored, included = found.measured - found.ignored, found.measured - found.included
    straight = abs(lateral_m_s) < LATERAL.min_speed_m_s
    signed = 0.0 if straight else float(np.copysign(trial.asked_m_s, lateral_m_s))
    faster = float(np.sign(trial.trial.current_a) * np.mean(ignored[-LEAD:]))
    driven = slice(LEAD, None)
    return Cell(
        trial.trial.label, trial.trial.current_a, signed, _rms(ignored[driven]),
        _rms(included[driven]), faster,
        published(signed, trial.trial.current_a),
    )  # fmt: skip


def together(cells: Sequence[Cell]) -> tuple[Together, ...]:
    """Return the aggregate of each sign of the lateral speed that was recorded, and of all."""
    groups = {
        "positive": [item for item in cells if item.lateral_speed_m_s > 0.0],
        "negative": [item for item in cells if item.lateral_speed_m_s < 0.0],
        "all": [item for item in cells if item.lateral_speed_m_s != 0.0],
    }
    return tuple(_together(name, items) for name, items in groups.items() if items)


def _together(name: str, cells: Sequence[Cell]) -> Together:
    known = [item.published for item in cells if item.published is not None]
    return Together(
        name,
        len(cells),
        _root_mean_square([item.ignored_m_s for item in cells]),
        _root_mean_square([item.included_m_s for item in cells]),
        float(np.mean([item.error_ignored_m_s for item in cells])),
        Published(
            _root_mean_square([item.ignored_m_s for item in known]),
            _root_mean_square([item.included_m_s for item in known]),
        )
        if known
        else None,
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _root_mean_square(values: Sequence[float]) -> float:
    return _rms(np.array(values))
