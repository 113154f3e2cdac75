"""Lateral sweeps in which one constant is stated wrong, and random ones in which all are right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

import numpy as np
from support.lugre.bench import FLOORS, known_rig
from support.lugre.lateral_bench import DRY, VISCOUS, LateralBench

from rigd_analyses.lugre.lateral.constants import LateralConstants, LateralTrial
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.rig.family import rig_system
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import Known, RigConstants
from rigd_analyses.lugre.trials.trial import sampling_period_s

#: Right in every world.
FIXED: Final = ("roller_transitions", "gravity", "guide_lift", "gear_ratio")
LENGTHS: Final = ("lever", "height", "half_span", "row_distance", "mass_offset")
RANGES_M_S: Final = ((0.2, 0.65), (0.2, 0.5), (0.35, 0.65))
CURRENTS_A: Final = ((0.6, 1.2), (0.9, 1.5), (0.6, 1.5))


@dataclass(frozen=True)
class Sweep:
    """A rig, its sweep, and what is stated: ``stated`` multiplies constants, by name.

    ``unknown`` moves them by so many of their uncertainties, which is no wrongness. ``added_m_s``
    and ``scale`` are errors of the lateral speed.
    """

    bench: LateralBench = field(default_factory=LateralBench)
    stated: Mapping[str, float] = field(default_factory=dict)
    unknown: Mapping[str, float] = field(default_factory=dict)
    added_m_s: float = 0.0
    scale: float = 1.0
    speeds: tuple[float, ...] = RANGES_M_S[0]
    currents: tuple[float, ...] = CURRENTS_A[0]
    seed: int = 2

    @property
    def truth(self) -> dict[str, float]:
        """Return what is sought."""
        return {"mu_R_dry": self.bench.dry, "mu_R_vis": self.bench.viscous}

    @property
    def rig(self) -> RigConstants:
        """Return what the rig file states of the rig along the guide."""
        right = known_rig(self.bench.bench.constants)
        return replace(right, **self._stated(right, [f.name for f in fields(RigConstants)]))

    @property
    def constants(self) -> LateralConstants:
        """Return what the rig file states of the coupling."""
        right = self.bench.constants
        return replace(right, **self._stated(right, LENGTHS))

    def trials(self) -> list[LateralTrial]:
        """Return what is recorded."""
        made = self.bench.sweep(self.seed, self.speeds, self.currents)
        return [
            replace(item, speed_m_s=self.scale * item.speed_m_s + self.added_m_s) for item in made
        ]

    @property
    def system(self) -> LateralSystem:
        """Return the system of all trials, with their lateral speeds as measured."""
        return lateral_system(self.trials(), self.constants, self.rig)

    def _stated(self, right: object, names: list[str] | tuple[str, ...]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name in names:
            factor, moved = self.stated.get(name, 1.0), self.unknown.get(name, 0.0)
            known = getattr(right, name)
            if isinstance(known, Known) and (factor, moved) != (1.0, 0.0):
                found[name] = Known(factor * known.value + moved * known.u, known.u)
        return found


#: By name, with the words one of which names it.
WRONG: Final[Mapping[str, Sweep]] = {
    **{
        f"{name} stated x {factor:g}": Sweep(stated={name: factor})
        for name, factors in {
            "lever": (0.5, 0.8, 1.2, 1.25, 2.0, -1.0),
            "height": (0.8, 1.2),
            "half_span": (2.0,),
            "row_distance": (1.5,),
            "mass_offset": (0.5, 1.5),
            "guide_friction": (0.2, 0.5, 2.0),
            "rolling_resistance": (0.5,),
            "mass": (0.8, 1.05, 1.2),
            "wheel_radius": (1.004,),
        }.items()
        for factor in factors
    },
    "lever stated x 0.5, 0.9 and 1.5 A": Sweep(stated={"lever": 0.5}, currents=CURRENTS_A[1]),
    "lateral speed + 20 mm/s": Sweep(added_m_s=0.02),
    "lateral speed x 1.1": Sweep(scale=1.1),
    "lateral speed turned": Sweep(scale=-1.0),
}


def lateral_system(
    trials: Sequence[LateralTrial], constants: LateralConstants, rig: RigConstants
) -> LateralSystem:
    """Return the system of ``trials``, all of which can be fitted."""
    recorded = [item.trial for item in trials]
    parts, _ = sort_out(recorded, [sampling_period_s(item) for item in recorded], Settings())
    straight = rig_system(parts, rig, np.array([parameter.start for parameter in PARAMETERS]))
    speeds = tuple(item.speed_m_s[part] for item, (_, part) in zip(trials, parts, strict=True))
    return LateralSystem(straight, speeds, constants, rig.bearing_torque.value)


def right(number: int) -> Sweep:
    """Return a sweep in which nothing is wrong: each constant is stated within its uncertainty.

    Floor, mass, friction of the rollers, lifted rows, speeds and currents vary.
    """
    rng = np.random.default_rng([77, number])
    mass, dry, viscous = np.exp([0.15, 0.3, 0.3] * rng.standard_normal(3))
    bench = LateralBench(
        physical=bool(number % 2), floor=list(FLOORS)[number % 3], mass_kg=3.9593 * float(mass),
        dry=DRY * float(dry), viscous=VISCOUS * float(viscous),
    )  # fmt: skip
    names = [f.name for f in fields(RigConstants) if f.name not in FIXED]
    unknown = {name: float(rng.standard_normal()) for name in (*names, *LENGTHS)}
    return Sweep(
        bench, unknown=unknown, speeds=RANGES_M_S[number // 3 % 3],
        currents=CURRENTS_A[number // 2 % 3], seed=number + 10,
    )  # fmt: skip
