"""Computes the uncertainty budget of F_r/N: 13 terms, by propagation (JCGM 100:2008, 5.1).

The model of the friction coefficient, with rho = R_eff/R, is:

    mu = [K_T dV - Z - X - I dw/dt - (b0 + b1 w + bN N) - C_rr N R]/(rho R N) + variation

Z is the zero of the gauges, X the crosstalk of bending. With D = rho R N mu, the moment of the
friction, the relative sensitivities c = (1/mu) dmu/dx are

    K_T: T/(K_T D)    any torque (Z, X, noise, T_b): 1/D    I: (dw/dt)/D    C_rr: 1/(rho mu)
    rho: 1/rho    N: (D + bN N + C_rr N R)/(N D)    variation of N or of mu itself: 1

The inputs count as independent (5.2 does not apply: each comes from another experiment).

The budget has a second column, for the method of the paper. It treats each effect that this method
leaves uncorrected as an uncertainty of that size. The GUM requires the correction of a known bias
(3.2.4); the column is for comparison only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from rigd.analysis.estimates import Share
from rigd_analyses.approach_angle.raw.run_data import AngleCalibration, AngleRig, Coefficient, Known

#: Share of N by which it changes in a run, at most: what the span of a load cell can be wrong by.
CELL_SHARE = 0.1
FORCE_TERMS = 8  #: torque and drags come first, then what concerns N, the surface last


@dataclass(frozen=True)
class Conditions:
    """The conditions of one run, or the medians over the runs of a set."""

    mu: float
    torque_nm: float  #: at the gauges
    normal_force_n: float
    wheel_speed_rad_s: float
    wheel_acceleration_rad_s2: float
    travel_m: float  #: of the platform since the start, mean
    turns: float  #: of the wheel, over the evaluated part
    samples: float  #: at 9600 Hz, in the evaluated part


@dataclass(frozen=True)
class Sizes:
    """Standard uncertainties (k = 1) that neither the calibration nor the rig file gives.

    ``zero_nm`` is what is left of the gauges' zero: the spread of the zeros before the triggers
    (or their size, if they cannot be told from crosstalk), and ``tare_nm`` the noise of one such
    zero, which is all that is left if ``tared``. A zero that is not taken off may be the same in
    all runs.
    ``crosstalk`` is the amplitude of N m per N of load (0: unknown), ``crosstalk_u`` what is left
    of it after its removal. ``scatter`` is the relative spread between equal runs.
    """

    zero_nm: float
    tare_nm: float
    tared: bool
    noise_nm: float  #: of one sample
    crosstalk: float
    crosstalk_u: float
    scatter: float
    scatter_kind: str  #: "A" if the campaign gave it
    inertia: float  #: relative
    load_reading_n: float
    load_change: float  #: relative, of N in a run beside its rise with the travel
    load_cell: bool  #: whether that one was used
    vibration: float  #: relative


@dataclass(frozen=True)
class BudgetTerm:
    """One source of uncertainty of F_r/N, k = 1, relative to mu.

    ``paper`` is what it costs the paper's T/(R N), if a known bias that is left uncorrected
    counts with its full size (for comparison only: GUM 6.3.1 note requires its correction),
    ``better`` what remains of it here. ``input_u`` in ``unit`` and ``sensitivity`` = d(ln
    mu)/d(input) give ``better`` = |sensitivity| input_u.
    """

    name: str
    input_u: float
    unit: str
    sensitivity: float
    paper: float
    better: float
    kind: (
        str  #: "A" from the spread of the data, "B" from other knowledge (JCGM 100:2008, 4.2, 4.3)
    )
    systematic: bool  #: the same in all runs of a set: repeating does not lessen it
    uncorrected: bool  #: the paper's column holds a bias that is not corrected
    source: str  #: origin of the size, one sentence
    #: What stated constants add to the logarithm of mu, each if it is 1 u larger.
    shares: tuple[Share, ...] = ()

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "name": self.name,
            "input_u": self.input_u,
            "input_unit": self.unit,
            "relative_sensitivity_per_unit": self.sensitivity,
            "relative_u_k1": {"paper": self.paper, "better": self.better},
            "type": self.kind,
            "systematic": self.systematic,
            "paper_uncorrected": self.uncorrected,
            "source": self.source,
        }


@dataclass(frozen=True)
class Budget:
    """The uncertainty budget of one set, or of one run, under the stated conditions."""

    terms: tuple[BudgetTerm, ...]
    at: Conditions
    sizes: Sizes
    runs: int
    coefficient: Coefficient = Coefficient.ROLLING

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "coefficient": self.coefficient,
            "mu": self.mu,
            "load_N": self.load_n,
            "wheel_speed_rad_per_s": self.wheel_speed_rad_s,
            "runs": self.runs,
            "relative_u_k1": {"paper": self.paper, "better": self.better},
            "relative_U_k2": {"paper": 2 * self.paper, "better": 2 * self.better},
            "terms": self.terms,
        }

    @property
    def mu(self) -> float:
        """The F_r/N that the terms are relative to."""
        return self.at.mu

    @property
    def load_n(self) -> float:
        """Normal force in N under which they hold."""
        return self.at.normal_force_n

    @property
    def wheel_speed_rad_s(self) -> float:
        """Wheel speed under which they hold."""
        return self.at.wheel_speed_rad_s

    @property
    def paper(self) -> float:
        """Combined relative standard uncertainty (k = 1) of the paper's method."""
        return math.sqrt(math.fsum(t.paper**2 for t in self.terms))

    @property
    def better(self) -> float:
        """Combined relative standard uncertainty (k = 1) of one number by the corrected method."""
        return math.sqrt(math.fsum(t.better**2 for t in self.terms))

    @property
    def measurement(self) -> float:
        """``better`` of this one run: without the last term, what varies from run to run."""
        return math.sqrt(math.fsum(t.better**2 for t in self.terms[:-1]))

    @property
    def force(self) -> float:
        """Relative standard uncertainty of F_r alone, corrected method: all but N's terms."""
        return math.sqrt(math.fsum(t.better**2 for t in self.terms[:FORCE_TERMS]))

    @property
    def shares(self) -> tuple[Share, ...]:
        """What stated constants add to the logarithm of mu; more runs do not lessen it."""
        return tuple(share for t in self.terms if t.systematic for share in t.shares)

    @property
    def systematic(self) -> float:
        """That part of ``better`` which more runs do not lessen."""
        return math.sqrt(math.fsum(t.better**2 for t in self.terms if t.systematic))


def budget(
    at: Conditions, calibration: AngleCalibration, rig: AngleRig, sizes: Sizes, runs: int = 1
) -> Budget:
    """Return the 13 terms of one number obtained under ``at``."""
    return Budget(
        terms=(
            *_torque_terms(at, calibration, sizes, rig),
            *_drag_terms(at, rig, sizes),
            *_load_terms(at, calibration, rig, sizes),
        ),
        at=at,
        sizes=sizes,
        runs=runs,
    )


def set_budget(
    runs: Sequence[Budget], calibration: AngleCalibration, rig: AngleRig, scatter: float | None
) -> Budget:
    """Return the budget of a set: the medians of the conditions and sizes of its runs.

    ``scatter`` is the relative spread between runs that the set shows, None if it shows none.
    """
    at = Conditions(
        **{f.name: _median([getattr(b.at, f.name) for b in runs]) for f in fields(Conditions)}
    )
    first = runs[0].sizes
    sizes = replace(
        first,
        zero_nm=_median([b.sizes.zero_nm for b in runs]),
        tare_nm=_median([b.sizes.tare_nm for b in runs]),
        noise_nm=_median([b.sizes.noise_nm for b in runs]),
        tared=all(b.sizes.tared for b in runs),
        load_cell=all(b.sizes.load_cell for b in runs),
        scatter=first.scatter if scatter is None else scatter,
        scatter_kind="B" if scatter is None else "A",
    )
    return budget(at, calibration, rig, sizes, len(runs))


def _median(values: Sequence[float]) -> float:
    return float(np.median(np.array(values)))


def _moment(at: Conditions, rig: AngleRig) -> float:
    """Return D = rho R N mu in N m."""
    return rig.effective_radius.value * rig.wheel_radius_m * at.normal_force_n * at.mu


def _term(
    name: str,
    input_u: float,
    unit: str,
    sensitivity: float,
    source: str,
    *,
    paper: float | None = None,
    kind: str = "B",
    systematic: bool = True,
    uncorrected: bool = False,
    shares: Iterable[Share] = (),
) -> BudgetTerm:
    """Return a term; the paper's column is the same as ours unless ``paper`` is given."""
    better = abs(sensitivity * input_u)
    return BudgetTerm(
        name, input_u, unit, sensitivity, better if paper is None else abs(paper), better,
        kind, systematic, uncorrected, source, tuple(shares),
    )  # fmt: skip


def _share(name: str, known: Known, slope: float) -> Share:
    """Return what a constant adds; ``slope`` is d(ln mu)/d(constant)."""
    return Share(name, known.value, known.u, slope * known.u)


def _torque_terms(
    at: Conditions, calibration: AngleCalibration, sizes: Sizes, rig: AngleRig
) -> Sequence[BudgetTerm]:
    """Return what the measured torque adds to the uncertainty of mu: scale, zero, noise."""
    per_nm = 1.0 / _moment(at, rig)
    scale = calibration.torque
    noise = sizes.noise_nm / np.sqrt(max(at.samples, 1))
    # A mean over whole turns holds no crosstalk; over a part of one it holds up to its amplitude.
    share = 1.0 / np.sqrt(2.0) / max(1.0, np.pi * at.turns)
    crosstalk = sizes.crosstalk * at.normal_force_n * share
    # What is wrong at the start's angle goes into the zero and stays at any turn of the wheel.
    left = sizes.crosstalk_u * at.normal_force_n * math.hypot(1.0, math.sqrt(2.0) * share)
    return (
        _term("torque calibration", scale.u, "N m/V", at.torque_nm * per_nm / scale.value,
              "the calibration's own uncertainty: mass, arm, gravity, fit",
              shares=[_share("torque_scale", scale, at.torque_nm * per_nm / scale.value)]),
        _term("gauge zero", sizes.tare_nm if sizes.tared else sizes.zero_nm, "N m", per_nm,
              "tared: the noise of one zero; else the zeros before the triggers, which all runs "
              "may share",
              paper=sizes.zero_nm * per_nm, kind="A", systematic=not sizes.tared),
        _term("gauge noise and hum", noise, "N m", per_nm,
              "spread of neighbouring samples, over the number of samples; blocks are whole "
              "periods of the mains", kind="A", systematic=False),
        _term("bending crosstalk", left if sizes.tared else crosstalk, "N m", per_nm,
              "once-per-turn part of the torque in the campaign's sliding runs, over the turns "
              "of a run", paper=crosstalk * per_nm, kind="A", uncorrected=True),
    )  # fmt: skip


def _drag_terms(at: Conditions, rig: AngleRig, sizes: Sizes) -> Sequence[BudgetTerm]:
    """Return what inertia, bearing, rolling resistance and radius of the wheel add."""
    per_nm = 1.0 / _moment(at, rig)
    rho = rig.effective_radius
    w, n = abs(at.wheel_speed_rad_s), at.normal_force_n
    constant, viscous, load = rig.bearing_constant, rig.bearing_viscous, rig.bearing_load
    bearing = constant.value + viscous.value * w + load.value * n
    bearing_u = float(np.hypot(np.hypot(constant.u, viscous.u * w), load.u * n))
    rolling = rig.rolling_resistance
    inertia = rig.wheel_inertia * at.wheel_acceleration_rad_s2
    drawn = Known(rig.wheel_inertia, sizes.inertia * rig.wheel_inertia)
    return (
        _term("wheel inertia", sizes.inertia * rig.wheel_inertia, "kg m^2",
              at.wheel_acceleration_rad_s2 * per_nm, "drawing of wheel and shaft",
              paper=inertia * per_nm, uncorrected=True,
              shares=[_share("wheel_inertia", drawn, -at.wheel_acceleration_rad_s2 * per_nm)]),
        _term("bearing friction", bearing_u, "N m", per_nm,
              "calibration of b0, b1 and bN, at this speed and load",
              paper=bearing * per_nm, uncorrected=True,
              shares=[
                  _share("bearing_constant", constant, -per_nm),
                  _share("bearing_viscous", viscous, -per_nm * w),
                  _share("bearing_load", load, -per_nm * n),
              ]),
        _term("rolling resistance", rolling.u, "1", 1.0 / (rho.value * at.mu),
              "calibration", paper=rolling.value / (rho.value * at.mu), uncorrected=True,
              shares=[_share("rolling_resistance", rolling, -1.0 / (rho.value * at.mu))]),
        _term("effective radius", rho.u, "1", 1.0 / rho.value, "calibration",
              paper=float(np.hypot(1.0 - rho.value, rho.u)), uncorrected=True,
              shares=[_share("effective_radius", rho, -1.0 / rho.value)]),
    )  # fmt: skip


def _load_terms(
    at: Conditions, calibration: AngleCalibration, rig: AngleRig, sizes: Sizes
) -> Sequence[BudgetTerm]:
    """Return what the normal force adds to the uncertainty of mu."""
    by_load = rig.bearing_load.value + rig.rolling_resistance.value * rig.wheel_radius_m
    to_load = (1.0 + by_load * at.normal_force_n / _moment(at, rig)) / at.normal_force_n
    scale = calibration.load.u / calibration.load.value
    cell = calibration.normal_force if sizes.load_cell else None
    # The cell shows what changes from the start on, which the scale has given.
    span = scale if cell is None else math.hypot(scale, CELL_SHARE * cell.u / cell.value)
    by_span = -to_load * at.normal_force_n
    shares = [_share("load_scale", calibration.load, by_span / calibration.load.value)]
    if cell is not None:
        shares.append(_share("normal_force_scale", cell, CELL_SHARE * by_span / cell.value))
    unseen = math.hypot(sizes.load_change, rig.load_rise.u * at.travel_m)
    change = 0.0 if cell else unseen
    return (
        _term("span of the normal force", span * at.normal_force_n, "N", to_load,
              "calibration of the scale, and of the high-rate load cell if it was used",
              paper=scale, shares=shares),
        _term("reading of the scale", sizes.load_reading_n, "N", to_load, "resolution and noise",
              paper=sizes.load_reading_n / at.normal_force_n, systematic=False),
        _term("change of the normal force in a run", change, "1", 1.0,
              "rise along the rails (calibration) and tilting, settling of the ground (assumed); "
              "seen by the high-rate load cell if it was used",
              paper=math.hypot(unseen, rig.load_rise.value * at.travel_m), uncorrected=True,
              shares=() if cell else [_share("load_rise", rig.load_rise, -at.travel_m)]),
        _term("roller vibration of the normal force", sizes.vibration, "1", 1.0,
              "assumed: it averages out over a run", systematic=False),
        _term("surface, and all that varies from run to run", sizes.scatter, "1", 1.0,
              "robust spread of the runs about the pooled curve"
              if sizes.scatter_kind == "A" else "assumed: too few runs to see it",
              kind=sizes.scatter_kind, systematic=False),
    )  # fmt: skip
