"""Worlds in which one thing is not as in the model and the rig file, as data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from support.lugre import physics as physics
from support.lugre.bench import FLOORS, Floor, known_rig
from support.lugre.physics import FloatArray, Physics
from support.lugre.sensors import Logger, Sensor

from rigd_analyses.lugre.trials.known_constants import Known, RigConstants
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

PERIOD_S = 1e-3
REST = 350  #: samples before the drive
ROWS = 5  #: of the simulation for each sample: sensors look between samples
#: Currents in A with their durations in s, one trial after the other. The carriage is braked at
#: the end of the track.
Program = tuple[tuple[tuple[float, float], ...], ...]
CONSTANT: Final[Program] = tuple(((round(0.15 * k, 2), 3.0),) for k in range(1, 11))
#: Constant currents, braking by the motor, and back again.
BACK: Final[Program] = (
    *(((current, 3.0),) for current in (0.3, 0.45, 0.75, 1.2)),
    ((0.9, 0.6), (-0.6, 0.5)),
    ((1.35, 0.5), (-0.9, 0.45)),
    ((0.75, 0.6), (-0.75, 1.3)),
    ((1.2, 0.4), (-1.2, 1.0)),
)
ACCELEROMETER = Sensor(noise=0.03, count=0.0119682, zero=0.02)
MONITOR = Sensor(noise=0.006, count=0.00305)
WHEEL = Sensor(count=2.0 * math.pi / (1024 * 20.25))
GUIDE = Sensor(count=3.0679616e-05)
LOGGER = Logger()
GUIDE_RADIUS_M = 0.02


@dataclass(frozen=True)
class World:
    """What is true of a rig and its sensors, what happens over the trials, and what is stated.

    ``stated`` multiplies a constant of the rig file; ``unknown`` moves what is true of it
    by so many of its uncertainties, which is no wrongness.
    """

    floor: str
    physics: Physics
    wheel: Sensor = WHEEL
    guide: Sensor = GUIDE
    accelerometer: Sensor = ACCELEROMETER
    current: Sensor = MONITOR
    program: Program = CONSTANT
    guide_eccentric: float = 0.0  #: m
    guide_slips: float = 0.0  #: share of its way that the measuring wheel loses at 1 m/s^2
    tilt: float = 0.0  #: rad, of the accelerometer's axis
    shake: float = 0.15  #: (m/s^2)/(m/s) that only the accelerometer sees, 36 times per turn
    wanted: float = 0.0  #: 1: the monitor shows what the amplifier is asked for
    worn: float = 0.0  #: share of friction lost from the first trial to the last
    softened: float = 0.0  #: share of sigma_0 lost from the first trial to the last
    loaded: float = 0.0  #: share of mass gained from the first trial to the last
    swapped: int = 0  #: trials that were on another floor
    edge_share: float = 0.0  #: how far another floor, 0.5 m away, differs on the way to that one
    fades: float = 0.0  #: share of K_t lost from the first trial to the last
    shrinks: float = 0.0  #: share of wheel radius lost from the first trial to the last
    turned: int = 0  #: trials in which the carriage encoder counts the other way
    held_late_s: float = 0.0  #: by which the brake acts before it is recorded
    logger: Logger = LOGGER
    at_rest_a: float = 0.0  #: which flow before the drive
    forgotten: float = 0.0  #: share of mass that one trial lacks
    knocked: float = 0.0  #: N for 50 ms in one trial
    idles: float = 0.0  #: share of no-load torque lost over the trials, most of it at first
    guide_gives: float = 0.0  #: s^2: by which the measuring wheel lags with each m/s^2
    crossed: int = 0  #: 1: columns of current and acceleration, 2: order of rows, 3: both
    cut_s: float = 0.0  #: cut out of the middle of a trial, without a gap in its times
    stated: Mapping[str, float] = field(default_factory=dict)
    unknown: Mapping[str, float] = field(default_factory=dict)

    @property
    def truth(self) -> Mapping[str, float]:
        """Return what the identification is asked for, as far as it exists in this world."""
        q, fresh = self.physics, self._mean_share
        if q.rigid:
            return {"sigma_2": q.s2}
        if q.strengthens:
            return {"mu_s": q.mu_s, "sigma_0": q.s0, "sigma_1": q.s1, "sigma_2": q.s2}
        stiffness = q.s0 * (1.0 - 0.5 * self.softened) * (1.0 - 0.75 * q.soft)  # of new bristles
        return {
            "V_s": q.v_s, "mu_c": fresh * q.mu_c, "mu_s": fresh * q.mu_s,
            "sigma_0": stiffness, "sigma_1": q.s1, "sigma_2": q.s2,
            "sigma_1+sigma_2": q.s1 + q.s2, "mu_s-mu_c": fresh * (q.mu_s - q.mu_c),
        }  # fmt: skip

    def g(self, slip: FloatArray) -> FloatArray:
        """Return the friction at ``slip`` in m/s, the mean over what changes it."""
        q = self.physics
        curve = q.mu_c + (q.mu_s - q.mu_c) * np.exp(-((slip / q.v_s) ** q.exponent))
        curve = curve * (1.0 + q.strengthens * np.log1p(slip / 0.01))
        return np.asarray(self._mean_share * curve)

    @property
    def _mean_share(self) -> float:
        """Return the mean of what changes all friction, over the trials and the track."""
        return (1.0 - 0.5 * self.worn) * (1.0 + self.physics.dust * (0.5 * physics.TRACK_M - 0.5))

    @cached_property
    def constants(self) -> LugreConstants:
        """Return the constants of method A, as stated."""
        rig = self.rig
        return LugreConstants(
            mass_kg=rig.mass.value,
            wheel_radius_m=rig.wheel_radius.value,
            guide_friction_n=rig.guide_friction.value,
            rolling_resistance=rig.rolling_resistance.value,
            guide_lift_n=rig.guide_lift.value,
        )

    @cached_property
    def rig(self) -> RigConstants:
        """Return what the rig file states."""
        q = self.physics
        true = LugreConstants(q.mass, q.radius, physics.GUIDE_DRY * q.mass * physics.G0, q.mu_rol)
        right = known_rig(true)
        changed = {
            "torque_constant": q.torque_constant, "gear_ratio": q.gear_ratio,
            "gear_efficiency": q.efficiency, "no_load_torque": q.no_load,
            "no_load_viscous": q.no_load_viscous, "motor_inertia": q.motor_inertia,
            "wheel_inertia": q.wheel_inertia, "wheel_radius": q.radius,
        }  # fmt: skip
        known = {
            name: replace(getattr(right, name), value=value) for name, value in changed.items()
        }
        for name, share in self.unknown.items():
            old = known.get(name, getattr(right, name))
            known[name] = replace(old, value=old.value + share * old.u)
        for name, factor in self.stated.items():
            if name == "roller_transitions":
                continue
            old = known.get(name, getattr(right, name))
            known[name] = Known(old.value * factor, old.u)
        transitions = right.roller_transitions * self.stated.get("roller_transitions", 1.0)
        return replace(right, **known, roller_transitions=transitions)

    def trials(self, seed: int) -> list[LugreTrial]:
        """Return what is recorded; the seed is that of the noise and of where the rig stands."""
        return [self._trial(k, seed) for k in range(len(self.program))]

    def _physics(self, trial: int) -> Physics:
        share = trial / max(len(self.program) - 1, 1)
        q = self.physics
        if self.swapped and trial >= len(self.program) - self.swapped:
            other = FLOORS[_other(self.floor)]
            q = q._replace(**_friction(other, 1.0, q))
        if self.edge_share:
            mixed = _friction(FLOORS[_other(self.floor)], self.edge_share, q)
            q = q._replace(edge=0.5, **{f"far_{k}": v for k, v in mixed.items() if k != "mu_rol"})
        return q._replace(
            mu_c=q.mu_c * (1.0 - self.worn * share),
            mu_s=q.mu_s * (1.0 - self.worn * share),
            s0=q.s0 * (1.0 - self.softened * share),
            mass=q.mass * (1.0 + self.loaded * share) * (1.0 - self.forgotten * (trial == 1)),
            torque_constant=q.torque_constant * (1.0 - self.fades * share),
            radius=q.radius * (1.0 - self.shrinks * share),
            no_load=q.no_load * (1.0 - self.idles * (1.0 - math.exp(-3.0 * share))),
            knock=self.knocked * (trial == 1),
        )

    def _trial(self, number: int, seed: int) -> LugreTrial:
        commands = [np.full(REST, self.at_rest_a)]
        commands += [np.full(round(s / PERIOD_S), a) for a, s in self.program[number]]
        rng = np.random.default_rng([seed, number])
        q = self._physics(number)._replace(first_angle=rng.uniform(0.0, 2.0 * math.pi))
        rows = physics.drive(q, np.concatenate(commands), REST, 100, PERIOD_S, ROWS, 5e-5)
        t = rows[:, physics.TIME]
        at = t[::ROWS]
        angle, position = rows[:, physics.MOTOR_ANGLE], rows[:, physics.SENSED_POSITION]
        speed, a = rows[:, physics.SENSED_SPEED], rows[:, physics.SENSED_ACCELERATION]
        way = position - self.guide_slips * np.cumsum(np.abs(a) * speed) * (t[1] - t[0])
        around = rng.uniform(0.0, 2.0 * math.pi)
        way = way - self.guide_gives * a
        way = way + self.guide_eccentric * np.sin(way / GUIDE_RADIUS_M + around)
        shake = self.shake * speed * np.sin(36.0 * rows[:, physics.WHEEL_ANGLE])
        felt = a * math.cos(self.tilt) + shake
        amps = rows[:, physics.WANTED if self.wanted else physics.CURRENT]
        offsets = rng.uniform(0.0, 1.0, 2)
        when = self.logger.times(at)
        shown = {
            "wheel_angle_rad": self.wheel.show(t, angle, when, number, rng, offsets[0]),
            "carriage_position_m": self.guide.show(t, way, when, number, rng, offsets[1]),
            "acceleration_m_s2": self.accelerometer.show(t, felt, when, number, rng),
            "motor_current_a": self.current.show(t, amps, when, number, rng),
            "held": np.interp(when - self.held_late_s, t, rows[:, physics.BRAKED]).round(),
        }
        shown = {
            name: values if name == "held" else self.logger.write(at, values)
            for name, values in shown.items()
        }
        if self.crossed in (1, 3):
            felt, amps = shown["acceleration_m_s2"], shown["motor_current_a"]
            shown |= {"acceleration_m_s2": amps, "motor_current_a": felt}
        if self.crossed in (2, 3):
            order = np.argsort(np.abs(shown["motor_current_a"]), kind="stable")
            shown = {name: values[order] for name, values in shown.items()}
        if number >= len(self.program) - self.turned:
            shown["carriage_position_m"] = -shown["carriage_position_m"]
        kept = np.ones(len(at), dtype=np.bool_)
        if self.cut_s and number % 3 == 1:
            driven = np.flatnonzero(shown["held"][REST:] > 0.5)
            middle = REST + (driven[0] if driven.size else len(at) - REST) // 2
            kept[middle : middle + round(self.cut_s / PERIOD_S)] = False
        first = self.program[number][0][0]
        label = f"{number + 1}: {first:.2f} A"
        times = at[: int(kept.sum())]
        return LugreTrial(
            label=label,
            current_a=first,
            t_s=times,
            wheel_angle_rad=shown["wheel_angle_rad"][kept],
            carriage_position_m=shown["carriage_position_m"][kept],
            acceleration_m_s2=shown["acceleration_m_s2"][kept],
            motor_current_a=shown["motor_current_a"][kept],
            held=shown["held"][kept],
        )


def _friction(floor: Floor, share: float, q: Physics) -> dict[str, float]:
    """Return what ``share`` of the way from ``q`` to ``floor`` makes of friction, in logarithms."""
    names = ("v_s", "mu_c", "mu_s", "s0", "s1", "s2", "mu_rol")
    return {k: getattr(q, k) ** (1.0 - share) * getattr(floor, k) ** share for k in names}


def _other(floor: str) -> str:
    return {"stone": "pvc", "pvc": "paperboard", "paperboard": "stone"}[floor]


def control(number: int) -> World:
    """Return a world of its own in which nothing is wrong.

    Friction, mass and procedure vary; each constant is stated within its uncertainty.
    """
    rng = np.random.default_rng([41, number])
    floor = FLOORS[sorted(FLOORS)[number % 3]]
    q = right(sorted(FLOORS)[number % 3]).physics
    spread = {"v_s": 0.5, "s0": 0.25, "s1": 0.25, "s2": 0.1, "mu_rol": 0.15, "mass": 0.25}
    drawn = {k: getattr(q, k) * math.exp(s * rng.standard_normal()) for k, s in spread.items()}
    coulomb = floor.mu_c * math.exp(0.15 * rng.standard_normal())
    rise = (floor.mu_s / floor.mu_c - 1.0) * math.exp(0.4 * rng.standard_normal())
    q = q._replace(**drawn, mu_c=coulomb, mu_s=coulomb * (1.0 + rise))
    q = q._replace(ripple=0.3 * math.exp(0.25 * rng.standard_normal()))
    names = [
        f.name for f in fields(RigConstants) if f.name not in ("roller_transitions", "gravity")
    ]
    unknown = {name: float(rng.standard_normal()) for name in names}
    program = (CONSTANT, BACK)[number // 3 % 2]
    return World(sorted(FLOORS)[number % 3], q, program=program, unknown=unknown)


def right(floor: str, **changed: Any) -> World:
    """Return a world in which all is as in the rig file; ``changed`` are fields of it."""
    f = FLOORS[floor]
    q = Physics(f.v_s, f.mu_c, f.mu_s, f.s0, f.s1, f.s2, f.mu_rol)
    return World(floor, q, **changed)


@dataclass(frozen=True)
class Wrong:
    """A kind of wrongness: the field of :class:`World` that ``sizes`` (small to large) replace.

    ``field`` is dotted: ``physics.slope``, ``guide.delay_s``, ``stated.mass``. ``program`` is what
    must be played for it to act. ``told`` are words one of which names it in a diagnosis. ``also``
    are other fields with a value each, ``same`` those that are replaced by the size too.
    """

    name: str
    field: str
    sizes: tuple[float, float, float]
    unit: str
    told: tuple[str, ...] = ()
    program: Program = CONSTANT
    also: tuple[tuple[str, float], ...] = ()
    same: tuple[str, ...] = ()

    def world(self, base: World, size: float) -> World:
        """Return ``base`` with this wrong by ``size``."""
        base = replace(base, program=self.program)
        given = {**dict(self.also), **dict.fromkeys((self.field, *self.same), size)}
        for name, value in given.items():
            base = _changed(base, name, value)
        return base


def _changed(base: World, name: str, value: float) -> World:
    owner, _, last = name.rpartition(".")
    if not owner:
        kind = type(getattr(base, last))
        return replace(base, **{last: kind(value)})
    part = getattr(base, owner)
    if isinstance(part, Physics):
        return replace(base, physics=part._replace(**{last: value}))
    if isinstance(part, Mapping):
        return replace(base, stated={**part, last: value})
    return replace(base, **{owner: replace(part, **{last: value})})
