"""A made-up identification of three floors: the cases of a real one, without its cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.report import (
    Facts,
    Provenance,
    ReferenceCurve,
    ReportAttachment,
    ReportSection,
)
from rigd.analysis.result import (
    Autocorrelation,
    Curve,
    FloatArray,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Profile,
    ResidualTest,
    Signal,
    StartOutcome,
    TrialFit,
    TrialRejection,
    Verdict,
)

MASS_KG, GRAVITY = 3.9593, 9.81
NORMAL_N = MASS_KG * GRAVITY
NAMES = ("V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2")
UNITS = ("m/s", "1", "1", "1/m", "s/m", "s/m")
#: Table I of the paper.
FLOORS = {
    "Natural stone": (1.9643, 0.12, 0.1205, 11.451, 0.0809, 2.449),
    "PVC floor covering": (0.0044, 0.12, 0.15, 49.933, 0.372, 2.8084),
    "Paperboard": (0.817, 0.04, 0.07, 54.724, 0.6146, 2.4028),
}


def friction(v: FloatArray, table: tuple[float, ...]) -> FloatArray:
    v_s, mu_c, mu_s = table[:3]
    return np.asarray(mu_c + (mu_s - mu_c) * np.exp(-np.sqrt(np.abs(v) / v_s)))


def estimates(table: tuple[float, ...]) -> tuple[ParameterEstimate, ...]:
    _, mu_c, mu_s, s0, s1, s2 = table
    flat = "The profile stays below its threshold over the whole grid from 0.0001 to 10 m/s."
    help_v_s = "Reach slip speeds above V_s: hold the carriage and drive the wheel."
    return (
        ParameterEstimate(
            "V_s", "V_s", "m/s", "Stribeck speed", 9.87, None, None, None,
            Verdict.UNIDENTIFIABLE, flat, "profile", ("at bound",), help_v_s,
        ),
        ParameterEstimate(
            "mu_c", "µ_c", "1", "Coulomb friction", mu_c * 1.1, None, mu_c * 1.4, mu_c * 0.3,
            Verdict.WEAK, "The interval is open towards small values.", "profile", (),
            "Add constant currents at a lighter carriage.",
        ),
        ParameterEstimate(
            "mu_s", "µ_s", "1", "static friction", mu_s * 1.02, mu_s * 0.98, mu_s * 1.16,
            mu_s * 0.04, Verdict.WEAK, "Wide and lopsided.", "profile",
        ),
        ParameterEstimate(
            "sigma_0", "σ₀", "1/m", "bristle stiffness", s0 * 1.005, s0 * 0.985, s0 * 1.025,
            s0 * 0.01, Verdict.IDENTIFIABLE, "Two-sided interval, 2 % wide.",
        ),
        ParameterEstimate(
            "sigma_1", "σ₁", "s/m", "bristle damping", s1 * 1.3, s1 * 1.24, s1 * 1.36,
            s1 * 0.03, Verdict.BIASED, "Smoothing smears the jump of the slip: 12 to 45 % high.",
            advice="Use the output-error method.",
        ),
        ParameterEstimate(
            "sigma_2", "σ₂", "s/m", "viscous friction", s2 * 0.998, s2 * 0.99, s2 * 1.006,
            s2 * 0.004, Verdict.IDENTIFIABLE, "Two-sided interval, 1 % wide.",
        ),
    )  # fmt: skip


def trial(current_a: float, samples: int, rng: np.random.Generator) -> TrialFit:
    t = np.arange(samples) * 1e-3 * 2000 / samples
    moving = t > 0.2
    tau = np.where(moving, t - 0.2, 0.0)
    top = min(1.956, 1.45 * current_a)
    speed = top * (1.0 - np.exp(-tau / 0.22))
    slip = np.where(moving, 0.08 * current_a * np.exp(-tau / 0.25) * (1 - np.exp(-tau / 0.02)), 0)
    force = MASS_KG * top / 0.22 * np.exp(-tau / 0.22) * moving * (1 - np.exp(-tau / 0.01)) * 0.33
    shake = 0.12 * speed * np.sin(2 * np.pi * 18 * np.cumsum(speed) * (t[1] - t[0]) / 0.314)
    measured = force + shake + rng.normal(0.0, 0.09, samples)
    used = moving & (speed > 0.03) & ~((t > 1.2) & (t < 1.26))
    error = (measured - force)[used]
    return TrialFit(
        label=f"{current_a:.2f} A, run 1",
        condition=f"{current_a:.2f} A",
        output="traction_force",
        unit="N",
        t_s=t,
        measured=measured,
        fitted=force,
        used=used,
        rms=float(np.sqrt(np.mean(error**2))) if error.size else 0.0,
        r_squared=float(1 - error.var() / measured[used].var()) if error.size else 0.0,
        signals={
            "wheel_speed": Signal("m/s", speed + slip + rng.normal(0.0, 0.004, samples)),
            "carriage_speed": Signal("m/s", speed + rng.normal(0.0, 0.004, samples)),
            "relative_speed": Signal("m/s", slip + rng.normal(0.0, 0.002, samples)),
            "motor_current": Signal("A", np.where(moving, current_a, 0.0)),
        },
    )


def profile(name: str, unit: str, centre: float, width: float) -> Profile:
    values = centre * np.geomspace(0.1, 10.0, 31)
    cost = (np.log(values / centre) / width) ** 2
    reach = width * np.sqrt(3.84)
    closed = bool(reach < np.log(10.0))
    low, high = centre * np.exp(-reach), centre * np.exp(reach)
    return Profile(
        name, unit, values, cost, 3.84, float(low) if closed else None,
        float(high) if closed else None,
    )  # fmt: skip


def result(
    floor: str = "Natural stone", *, trials: int = 10, samples: int = 2000, seed: int = 1
) -> IdentificationResult:
    rng = np.random.default_rng(seed)
    table = FLOORS[floor]
    fits = tuple(trial(0.15 * k, samples, rng) for k in range(1, trials + 1))
    v = np.geomspace(0.002, 0.12, 80)
    g = friction(v, table)
    width = 0.004 + 0.006 * np.abs(np.log(v / 0.02))
    lag = np.arange(300, dtype=np.float64) * 1e-3
    starts = tuple(
        StartOutcome(
            dict(zip(NAMES, table, strict=True)),
            {n: x * (1 + 1e-4 * k) for n, x in zip(NAMES, table, strict=True)},
            101.0 + (k // 6) * 7.5,
            9 + k,
            k % 6 != 5,
        )
        for k in range(12)
    )
    parameters = estimates(table)
    derived = ParameterEstimate(
        "sigma_sum", "σ₁ + σ₂", "s/m", "damping at the start", 2.53, 2.49, 2.57, 0.02,
        Verdict.IDENTIFIABLE, "The sum is sharper than its parts.",
    )  # fmt: skip
    rho = np.eye(6) + 0.9 * (np.outer(np.linspace(-1, 1, 6), np.linspace(-1, 1, 6)))
    scale = np.sqrt(np.diag(rho))
    return IdentificationResult(
        model="LuGre",
        method="slip in, traction out",
        title=f"LuGre parameters of {floor.lower()} from {trials} constant currents",
        parameters=parameters,
        derived=(derived,),
        confidence=0.95,
        correlation_names=NAMES,
        correlation=rho / np.outer(scale, scale),
        cost=101.0,
        samples=int(sum(f.used.sum() for f in fits)),
        effective_samples=612.0,
        inflation=1.74,
        starts=starts,
        curve=Curve(
            "g", "slip_speed", "m/s", "friction_coefficient_g", "1", v, g,
            g * (1 - width), g * (1 + width),
        ),
        trials=fits,
        profiles=tuple(
            profile(n, u, x, w)
            for n, u, x, w in zip(NAMES, UNITS, table, (5, 0.6, 0.3, 0.1, 0.2, 0.05), strict=True)
        ),
        residual_tests=(
            ResidualTest("Ljung-Box", 812.3, 1e-9, False, "Neighbouring residuals are alike."),
            ResidualTest("Slip and force agree in sign", 0.93, None, True, "Correlation 0.93."),
        ),
        autocorrelation=Autocorrelation(lag, np.cos(60 * lag) / (1 + (lag / 0.03) ** 2), 0.012),
        preprocessing=Preprocessing(
            statements=("Savitzky-Golay, 31 ms, on slip and force alike.",),
            settings={"window_s": 0.031, "order": 2.0, "filter": "Savitzky-Golay"},
            per_trial={f.label: {"accelerometer_bias": 0.021, "share_used": 0.8} for f in fits},
            rejected=(TrialRejection("0.10 A, run 1", "the carriage did not move"),),
        ),
        visited="Slip of 0.002 to 0.12 m/s was visited; beyond it the curve is extrapolation.",
        warnings=("V_s lies outside the slip that was visited.",),
    )  # fmt: skip


def section(floor: str = "Natural stone", **options: int) -> ReportSection:
    table = FLOORS[floor]
    v = np.geomspace(0.001, 2.0, 400)
    return ReportSection(
        label=floor,
        result=result(floor, **options),
        reference=dict(zip(NAMES, table, strict=True)),
        reference_label="Table I of the paper",
        reference_curve=ReferenceCurve("Table I", v, friction(v, table)),
    )


@pytest.fixture(scope="session")
def provenance() -> Provenance:
    return Provenance(
        facts=(
            Facts(
                "Recording stone.mcap", {"sha256": "9f2c" * 16, "procedure": "lugre", "seed": "7"}
            ),
            Facts("Software", {"rigd": "0.1.0", "git revision": "4708940"}),
        ),
        attachments=(ReportAttachment("procedures/lugre.yaml", "trial:\n  current: 1.5 A\n"),),
    )


@pytest.fixture(scope="session")
def make_section() -> Callable[..., ReportSection]:
    """Return the maker of a section, ten trials of 2000 samples by default."""
    return section


@pytest.fixture(scope="session")
def three_floors() -> list[ReportSection]:
    """Return three floors, three trials each, 2000 samples a trial as in a real report."""
    return [section(floor, seed=seed, trials=3) for seed, floor in enumerate(FLOORS)]


@pytest.fixture(scope="session")
def page(three_floors: list[ReportSection], provenance: Provenance) -> str:
    """Return the report on :func:`three_floors`."""
    return ParameterEvaluation("Three floors", tuple(three_floors), (), provenance).report()


@pytest.fixture(scope="session")
def bare_section() -> ReportSection:
    """Return a section with one trial and nothing that a method may leave out."""
    full = result(trials=1, samples=200)
    bare = replace(
        full,
        derived=(),
        starts=(),
        profiles=(),
        residual_tests=(),
        correlation_names=("mu_c",),
        correlation=np.ones((1, 1)),
        parameters=full.parameters[1:2],
        preprocessing=Preprocessing((), {}, {}),
        warnings=(),
    )
    return ReportSection("One trial", bare)
