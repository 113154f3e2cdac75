"""Checks the rules that every friction law must keep; an author calls it in one line of pytest.

::

    def test_conforms() -> None:
        check_friction_law(AcmeLaw)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from rigd.analysis.fitting.fit import multi_start
from rigd.analysis.fitting.model import scaled_bounds, slopes, to_natural, to_scaled
from rigd.analysis.friction import compiled_law
from rigd.analysis.friction.law import FrictionLaw
from rigd.analysis.friction.model import STEP, LawModel, SlipForce
from rigd.analysis.result import FloatArray
from rigd.model.units import parse_unit
from rigd.sdk.check import Finding, NonConforming, Report

PERIOD_S: Final = 1e-3
#: Derivatives that are given may differ so much from differences, of the largest in their column.
DERIVATIVE_ERROR: Final = 1e-5
FLOOR: Final = 1e-4
#: Constant slips in m/s, and how many samples of which length in s they last.
SLIPS: Final = (0.005, 0.1, -0.05)
LASTING: Final = (20_000, 5e-3)
SETTLED: Final = 1e-6  #: of F_N
ROLLING: Final = (0.0, 0.5)  #: m/s
DRAWS: Final = 12
#: How far parameters lie from the start that are to be found again, as a share of the box.
AWAY: Final = 0.05
FOUND: Final = 1e-3  #: of the force's own rms


#: Without parameters and a force that is a number, the other rules cannot be checked.
NEEDED: Final = 2
#: What is asked for, and what yields each problem with what to do.
Rule = tuple[str, Callable[[type[FrictionLaw]], Iterator[tuple[str, str]]]]


def check_friction_law(law: type[FrictionLaw]) -> Report:
    """Check ``law``.

    Raises:
        NonConforming: a rule is broken; its report names each with what is asked for.
    """
    report = examine_friction_law(law)
    if report.findings:
        raise NonConforming(report)
    return report


def examine_friction_law(law: type[FrictionLaw]) -> Report:
    """Return what :func:`check_friction_law` finds, without raising."""
    rules: list[Rule] = [
        ("declares its parameters", _declared),
        ("gives a number at any slip", _finite),
        ("gives no force without slip", _at_rest),
        ("gives the same force for the same slip", _repeatable),
        ("has right derivatives", _derivatives),
        ("settles at its steady force", _steady),
        ("opposes the slip", _opposing),
        ("is found again from its own force", _found_again),
    ]
    played: list[str] = []
    findings: list[Finding] = []
    for rule, check in rules:
        if findings and len(played) <= NEEDED:
            break
        played.append(rule)
        findings += [Finding(rule, *item) for item in check(law)]
    skipped = {rule: "the rules before it" for rule, _ in rules if rule not in played}
    return Report(law.__name__, tuple(findings), tuple(played), skipped)


def _declared(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    for name in ("parameters", "step"):
        if not hasattr(law, name):
            yield f"it has no {name}", "docs/friction_laws.md shows what a law declares"
            return
    names = [parameter.name for parameter in law.parameters]
    if not names:
        yield "it has no parameter", "name at least one in `parameters`"
    if double := sorted({name for name in names if names.count(name) > 1}):
        yield f"two parameters are called {', '.join(double)}", "give each a name of its own"
    for parameter in law.parameters:
        try:
            parse_unit(parameter.unit)
        except ValueError as error:
            yield f"parameter {parameter.name}: {error}", "give a unit that rigd knows, such as 1/m"
        if not (parameter.symbol and parameter.meaning):
            yield (
                f"parameter {parameter.name} has no symbol or no meaning",
                "give both: they stand in the report",
            )
    if law.states < 0:
        yield f"it has {law.states} states", "count the internal states, 0 for a law without"
    if not (law.__dict__.get("__doc__") or "").strip():
        yield "the class has no docstring", "its first line is the title in reports"


def _finite(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    for theta in _draws(law, 1.0):
        for slip in (*_excitation(), np.zeros(50), np.full(50, 1e-12)):
            if not np.all(np.isfinite(_every_step(law, theta, slip))):
                yield (
                    f"its force is no number {_at(law, theta)}",
                    "guard divisions and roots: a fit goes everywhere in the box",
                )
                return


def _at_rest(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    theta = _start(law)
    if np.any(_every_step(law, theta, np.zeros(50)) != 0.0):
        yield "it has a force at rest, with all states 0", "a trial begins relaxed"


def _repeatable(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    theta, (slip, *_) = _start(law), _excitation()
    once = _force(law, theta, slip)
    model = LawModel(law, [_trial(slip), _trial(slip)])
    if not np.array_equal(model.predict(theta), np.concatenate([once, once])):
        yield (
            "the same slip gives another force the second time",
            "keep all that it remembers in `state`",
        )


def _derivatives(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    if law.gradient is None:
        return
    model = LawModel(law, [_trial(slip) for slip in _excitation()])
    for theta in _draws(law, 0.2):
        scale = slopes(law.parameters, theta)
        given, differences = model.jacobian(theta) * scale, model.differences(theta) * scale
        # Differences resolve no less than this share of the force.
        floor = FLOOR * float(np.max(np.abs(model.predict(theta))))
        largest = np.maximum(np.max(np.abs(differences), axis=0), floor)
        error = np.max(np.abs(given - differences), axis=0) / largest
        worst = int(np.argmax(error))
        if not error[worst] <= DERIVATIVE_ERROR:
            yield (
                f"the derivative by {law.parameters[worst].name} is off by "
                f"{100 * error[worst]:.2g} % of its largest value, {_at(law, theta)}",
                "correct `gradient`, or leave it out: differences then stand in for it",
            )
            return
        if not np.isclose(model.normal_equations(theta).cost, model.cost(theta), rtol=1e-12):
            yield "`gradient` returns another force than `step`", "both compute the same sample"
            return


def _steady(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    theta = _start(law)
    count, period_s = LASTING
    for rolling in ROLLING:
        for slip in SLIPS:
            values, rollings = np.full(count, slip), np.full(count, rolling)
            force = _force(law, theta, values, period_s, rollings)[-1]
            stated = float(law.steady(theta, np.array([slip]), rolling)[0])
            if not abs(force - stated) <= SETTLED:
                yield (
                    f"at a slip of {slip:g} m/s, rolling at {rolling:g} m/s, the force is "
                    f"{force:.6g} after {count * period_s:g} s, `steady` returns {stated:.6g}",
                    "`steady` is what `step` comes to at a constant slip",
                )
                return


def _opposing(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    slip = np.array([-1.0, -0.1, -0.01, 0.01, 0.1, 1.0])
    if np.any(law.steady(_start(law), slip, 0.0) * slip <= 0.0):
        yield (
            "its steady force at the start has not the sign of the slip",
            "driving slip gives a driving force: both positive",
        )


def _found_again(law: type[FrictionLaw]) -> Iterator[tuple[str, str]]:
    low, high = scaled_bounds(law.parameters)
    start = to_scaled(law.parameters, _start(law))
    middle = 0.5 * (low + high)
    hidden = start + AWAY * (high - low) * np.where(start < middle, 1.0, -1.0)
    theta = to_natural(law.parameters, hidden)
    slips = _excitation()
    forces = [_force(law, theta, slip) for slip in slips]
    model = LawModel(law, [_trial(slip, force) for slip, force in zip(slips, forces, strict=True)])
    best = multi_start(model, starts=8, seed=1)[0]
    left = np.sqrt(2.0 * best.cost / len(model.mask))
    size = float(np.sqrt(np.mean(np.concatenate(forces) ** 2)))
    if not left <= FOUND * size:
        yield (
            f"eight fits to its own force leave {100 * left / size:.2g} % of it, hidden "
            f"{_at(law, theta)}",
            "choose start and box near what is usual, and LOG for parameters of unknown size",
        )


def _excitation() -> tuple[FloatArray, ...]:
    """Return slips in m/s: one that jumps, one that grows, one that reverses."""
    t_s: FloatArray = np.arange(1500, dtype=np.float64) * PERIOD_S
    jump = np.where(t_s < 0.05, 0.0, np.where(t_s < 0.7, 0.02, 0.12))
    grow = 0.2 * t_s**2
    turn = 0.08 * np.sin(2.0 * np.pi * 2.0 * t_s) * (1.0 - np.exp(-t_s / 0.05))
    return jump, grow, turn


def _trial(
    slip: FloatArray,
    force: FloatArray | None = None,
    period_s: float = PERIOD_S,
    rolling: FloatArray | None = None,
) -> SlipForce:
    measured = np.zeros_like(slip) if force is None else force
    return SlipForce("check", period_s, slip, measured, np.ones_like(slip), rolling)


def _force(
    law: type[FrictionLaw],
    theta: FloatArray,
    slip: FloatArray,
    period_s: float = PERIOD_S,
    rolling: FloatArray | None = None,
) -> FloatArray:
    return LawModel(law, [_trial(slip, None, period_s, rolling)]).predict(theta)


def _every_step(law: type[FrictionLaw], theta: FloatArray, slip: FloatArray) -> FloatArray:
    """Return F/F_N (n,) from a step at each sample, also at rest, which a fit leaves out."""
    nothing, dt = np.zeros_like(slip), np.full_like(slip, PERIOD_S)
    inputs = (slip, slip, nothing, dt, np.full_like(slip, compiled_law.FOLLOWS))
    return compiled_law.predict(law.step, law.states, theta, inputs)


def _start(law: type[FrictionLaw]) -> FloatArray:
    return np.array([parameter.start for parameter in law.parameters])


def _draws(law: type[FrictionLaw], share: float) -> Iterator[FloatArray]:
    """Yield the start, and parameters drawn around it from ``share`` of the box, inside it."""
    low, high = scaled_bounds(law.parameters)
    low, high = low + 2.0 * STEP, high - 2.0 * STEP
    centre = np.clip(to_scaled(law.parameters, _start(law)), low, high)
    rng = np.random.default_rng(1)
    yield to_natural(law.parameters, centre)
    for _ in range(DRAWS):
        away = 0.5 * share * (high - low) * rng.uniform(-1.0, 1.0, len(low))
        yield to_natural(law.parameters, np.clip(centre + away, low, high))


def _at(law: type[FrictionLaw], theta: FloatArray) -> str:
    values = zip(law.parameters, theta, strict=True)
    return "at " + ", ".join(f"{p.name} = {x:.4g}" for p, x in values)
