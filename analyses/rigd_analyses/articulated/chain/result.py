"""Makes the result of a fit of a chain: contacts of each module, or why there is none."""

from __future__ import annotations

from typing import Final

import numpy as np

from rigd.analysis.output_error.augmented_system import own_parameters
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.pipeline import Identification
from rigd.analysis.result import (
    Curve,
    FloatArray,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Signal,
    TrialFit,
    Verdict,
)
from rigd_analyses.articulated.chain.family import ChainFamily
from rigd_analyses.articulated.chain.geometry import RAW
from rigd_analyses.articulated.chain.needs import KINDS
from rigd_analyses.articulated.chain.suspects import Fitted
from rigd_analyses.articulated.chain.system import (
    UNITS,
    ChainSystem,
    Run,
    contact_name,
    unit_of,
)
from rigd_analyses.articulated.result import (
    ADVICE,
    OF_ALL,
    WHEELS,
    WORDS,
    Circle,
    drawn,
    error_along,
    estimated,
    fitted_values,
    force_curve,
    radii,
    stated,
)
from rigd_analyses.articulated.robot import CAMERA
from rigd_analyses.articulated.system import FREE

NO_SLIDING: Final = (
    "Trials in which a contact may slide are left out, so μ_s and μ_d get no number: the analysis "
    "`articulated` gives them, of two modules whose front one drives."
)


def result(found: Identification[ChainFamily], grip: float) -> IdentificationResult:
    """Return the result for a report; ``grip`` is the share of its load that a contact carries."""
    system, fit = found.family.system, found.whole
    at = Fitted(system, own_parameters(fit))
    runs = at.runs
    names = tuple(contact_name(kind, k) for kind, k in system.layout.contacts)
    shares = [
        system.loads(k, at.shared, at.local(k)).max(axis=0) for k in range(len(system.trials))
    ]
    largest = float(np.max(shares))
    return stated(
        found,
        model="articulated-chain",
        title=f"Contacts of the articulated robot of {system.layout.modules} modules",
        parameters=tuple(_estimates(found)),
        gradients={name: gradient_of(system, name, len(fit.covariance)) for name in names},
        curve=_curve(found, largest),
        trials=tuple(_trial_fit(at, fit, k, runs[k]) for k in range(len(system.trials))),
        preprocessing=_account(found, runs, [float(np.max(item)) for item in shares], grip),
        visited=f"contact forces up to {largest:.2f} of the load",
        notes=(NO_SLIDING,),
    )


def gradient_of(system: ChainSystem, name: str, count: int) -> FloatArray:
    """Return the derivative (count,) of the logarithm of a contact parameter to the scaled ones."""
    kind, _, number = name.rpartition("_")
    gradient, contacts = np.zeros(count), list(system.layout.contacts)
    first = system.layout.of_kind(kind)[0]
    gradient[contacts.index((kind, int(number) - 1))] = 1.0
    if not system.known:
        gradient[contacts.index((kind, first))] = 1.0
    return gradient


def value_of(system: ChainSystem, fit: OutputErrorFit, name: str) -> float:
    """Return a contact parameter of one module in its unit."""
    kind, _, number = name.rpartition("_")
    raw = system.raw(fit.fit.theta[: len(system.shared)])
    return float(raw[len(RAW) * (int(number) - 1) + RAW.index(kind)])


def _estimates(found: Identification[ChainFamily]) -> list[ParameterEstimate]:
    """Return the contacts of each module; if one is not known by itself, the mean of its kind."""
    system, fit, estimates = found.family.system, found.whole, list[ParameterEstimate]()
    for kind in KINDS:
        modules, count = system.layout.of_kind(kind), len(fit.covariance)
        names = [contact_name(kind, k) for k in modules]
        values = np.array([value_of(system, fit, name) for name in names])
        slopes = np.array([gradient_of(system, name, count) for name in names])
        symbol, meaning = WORDS[kind]
        own = []
        for name, k, value, slope in zip(names, modules, values.tolist(), slopes, strict=True):
            words = f"{meaning}; {system.layout.names[k]} module"
            labels = (name, f"{symbol} {k + 1}", UNITS[kind], words, value)
            own.append(_estimate(found, labels, slope, kind, fit.on_bound[_place(system, kind, k)]))
        estimates += own
        if len(own) > 1 and any(item.verdict is Verdict.UNIDENTIFIABLE for item in own):
            words = (
                f"{meaning}; mean of modules {', '.join(str(k + 1) for k in modules)}, because "
                "these data do not tell them apart"
            )
            labels = (kind, symbol, UNITS[kind], words, float(np.mean(values)))
            estimates.append(_estimate(found, labels, values @ slopes / values.sum(), kind, False))
    return estimates


def _place(system: ChainSystem, kind: str, module: int) -> int:
    return list(system.layout.contacts).index((kind, module))


def _estimate(
    found: Identification[ChainFamily], labels: tuple[str, str, str, str, float],
    gradient: FloatArray, kind: str, on_bound: bool,
) -> ParameterEstimate:  # fmt: skip
    least, most, _ = FREE[kind]
    return estimated(found, labels, gradient, (least, most), on_bound=on_bound, advice=ADVICE[kind])


def _curve(found: Identification[ChainFamily], share: float) -> Curve:
    """Return the longitudinal force over the slip of the first module that drives."""
    system, fit = found.family.system, found.whole
    module = system.layout.of_kind("k_lon")[0]
    name = contact_name("k_lon", module)
    value = value_of(system, fit, name)
    error = min(error_along(found, gradient_of(system, name, len(fit.covariance))), 10.0)
    load = float(system.wheel_loads(fit.fit.theta[: len(system.shared)])[4 * module])
    note = f" of the {system.layout.names[module]} module"
    return force_curve(found, value, error, share * load / value, note)


def _trial_fit(at: Fitted, fit: OutputErrorFit, index: int, run: Run) -> TrialFit:
    system = at.system
    along, across = system.forces(index, run)
    signals = {
        f"force {way} of the {wheel}, {module} module": Signal("N", part[:, 4 * k + wheel_at])
        for k, module in enumerate(system.layout.names)
        for wheel_at, wheel in enumerate(WHEELS)
        for way, part in (("along", along), ("across", across))
    }
    return drawn(system, fit, index, system.layout.names[0], signals)


def _account(
    found: Identification[ChainFamily], runs: list[Run], shares: list[float], grip: float
) -> Preprocessing:
    system, fit = found.family.system, found.whole
    layout = system.layout
    drives = sorted({motor.module for motor in layout.motors})
    driven = ", ".join(layout.names[k] for k in drives)
    return Preprocessing(
        statements=(
            f"The robot of {layout.modules} modules, of which motors drive {driven}, is simulated "
            "from the measured speeds of its motors. Each wheel bears a quarter of its own module, "
            "and no contact slides. So k_roll of a module is as much too small as its stated mass "
            "is too large: nothing else shows the load.",
            "Contacts of modules count as alike within a factor of e; the data decide by how much "
            "they differ.",
            *OF_ALL,
            *fitted_values(fit, (*system.sizes, *CAMERA), unit_of),
            *_radii(system, runs, drives[0]),
        ),
        settings={"certain_grip": grip},
        per_trial={
            item.label: {
                "frames": float(len(item.poses)),
                "seen": float(np.sum(item.seen[:, 0])),
                "largest force over load": share,
            }
            for item, share in zip(system.trials, shares, strict=True)
        },
        rejected=found.family.rejected,
    )


def _radii(system: ChainSystem, runs: list[Run], module: int) -> list[str]:
    """Return the mean radii of the first module that drives, if it does so on both sides."""
    own = [
        [
            k
            for k, item in enumerate(system.layout.motors)
            if (item.module, item.side) == (module, s)
        ]
        for s in (0, 1)
    ]
    if not all(own):
        return []
    circles = []
    for item, run in zip(system.trials, runs, strict=True):
        speeds = np.column_stack([np.mean(item.speeds[:, part], axis=1) for part in own])
        circles.append(Circle(item, run.pose[:, 3 * module : 3 * module + 3], speeds))
    half_track = system.constants[system.layout.key(module, "half_track")][0]
    return radii(circles, half_track, module)
