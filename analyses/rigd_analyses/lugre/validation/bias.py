"""Describes in words which constants of a recording must have other values to explain it."""

from __future__ import annotations

import math
from typing import Final

from rigd.analysis.report.rounding import number, percent, places_for
from rigd.analysis.validation.result import Bias
from rigd_analyses.lugre.validation.attempt import Attempt
from rigd_analyses.lugre.validation.motion import COLUMN, GAIN, LATE, ZERO, stated
from rigd_analyses.lugre.validation.search import pull, stated_u

#: Name, unit, factor from SI to it, and what it is, of constants that are fitted as they are.
PLAIN: Final = {
    "no_load": ("no_load_torque at the wheel, with bearings", "mN m", 1e3),
    "wheel_viscous": ("viscous torque at the wheel", "mN m s", 1e3),
    "wheel_inertia": ("inertia at the wheel", "kg m^2", 1.0),
    "guide_friction": ("guide_friction", "N", 1.0),
    "rolling_resistance": ("rolling_resistance", "1", 1.0),
    "drag": ("a drag on the carriage", "N s/m", 1.0),
    "slope": ("a slope of the floor, times gravity,", "m/s^2", 1.0),
    "wheel_radius": ("wheel_radius", "mm", 1e3),
}
#: No constant is printed finer than this share of it.
PERMILLE: Final = 1e-3
#: A mean of the current at rest within so many of its standard errors agrees.
AGREES: Final = 4.0


def biases(item: Attempt) -> tuple[Bias, ...]:
    """Return what ``item`` fitted, each with its sentence."""
    return tuple(bias(item, name) for name in item.names)


def bias(item: Attempt, name: str) -> Bias:
    """Return one constant that ``item`` fitted."""
    if name == GAIN:
        return _gain(item)
    if name == ZERO:
        return _zero(item)
    if name == LATE:
        return _late(item)
    motion = item.simulated[0].motion
    label, unit, factor = PLAIN[name]
    before = factor * float(stated(motion, item.simulated[0].q[:6])[COLUMN[name]])
    u = factor * item.error(name)
    value = before + factor * item.value(name)
    shown = "" if unit == "1" else f" {unit}"
    places = places_for(max(u, PERMILLE * abs(value)))
    sentence = (
        f"{label} would have to be {number(value, places)}{shown}, stated is "
        f"{number(before)}{shown}: {number(pull(item, name), digits=2)} of its uncertainties."
    )
    return Bias(name, unit, before, factor * stated_u(motion, name), value, u, sentence)


def rest_current(item: Attempt) -> tuple[float, float]:
    """Return the mean current in A that the monitor shows at rest, and its standard error."""
    motions = [simulated.motion for simulated in item.simulated]
    weights = [1.0 / max(motion.rest_u_a, 1e-9) ** 2 for motion in motions]
    mean = sum(w * m.rest_a for w, m in zip(weights, motions, strict=True)) / sum(weights)
    return mean, 1.0 / math.sqrt(sum(weights))


def shown_at_rest(item: Attempt) -> bool:
    """Whether the monitor shows at rest the zero that the motion asks for."""
    mean, u = rest_current(item)
    reach = AGREES * math.hypot(u, item.error(ZERO)) + stated_u(item.simulated[0].motion, ZERO)
    return abs(-item.value(ZERO) - mean) <= reach


def _gain(item: Attempt) -> Bias:
    known = item.simulated[0].motion.constants.torque_constant
    share = math.expm1(item.value(GAIN))
    value, u = known.value * (1.0 + share), known.value * item.error(GAIN)
    places = places_for(max(1e3 * u, PERMILLE * 1e3 * value))
    sentence = (
        f"torque_constant would have to be {number(1e3 * value, places)} mN m/A "
        f"({percent(share)}), stated is {number(1e3 * known.value)} mN m/A. The motion shows "
        "its product with gear_efficiency and gear_ratio, over the mass."
    )
    stated_share = stated_u(item.simulated[0].motion, GAIN)
    return Bias(
        "torque_constant", "N m/A", known.value, known.value * stated_share, value, u, sentence
    )


def _zero(item: Attempt) -> Bias:
    value, u = -item.value(ZERO), item.error(ZERO)
    mean, mean_u = rest_current(item)
    sentence = (
        f"The current's zero would have to be {_signed(1e3 * value)} mA, stated is 0 mA; at rest "
        f"the monitor shows {_signed(1e3 * mean)} mA (± {number(1e3 * mean_u, digits=2)} mA)."
    )
    if doubt := item.doubt(ZERO):
        sentence += (
            " What is stated of no-load torque, resistances and slope would allow "
            f"±{number(1e3 * doubt, digits=2)} mA."
        )
    return Bias(
        "current_zero", "A", 0.0, stated_u(item.simulated[0].motion, ZERO), value, u, sentence
    )


def _late(item: Attempt) -> Bias:
    value = item.value(LATE)
    encoder = "carriage" if value > 0.0 else "wheel"
    sentence = (
        f"The {encoder} encoder would have to read {number(1e3 * abs(value), digits=2)} ms late, "
        "stated is that both are sampled at the same time."
    )
    u = stated_u(item.simulated[0].motion, LATE)
    return Bias(f"{encoder}_delay", "s", 0.0, u, abs(value), item.error(LATE), sentence)


def _signed(value: float) -> str:
    """Return a current in mA to a tenth, with its sign."""
    return ("+" if value > 0.0 else "") + number(value, 1)
