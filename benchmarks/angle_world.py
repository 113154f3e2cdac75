"""Another simulator of the approach-angle rig, which shares no code with rigd's own plant.

Written from docs/physics/angle.md alone, and different from the plant wherever that text leaves a
choice: an adaptive implicit scheme (LSODA) instead of fixed steps; bristles that relax like Dahl's
instead of LuGre's; another shape of the friction over speed; normal force, gauges, potentiometers,
converter and scale that err in other ways. Every rig is drawn: its friction, drags, drive, sensors,
and what a calibration knows of it, within the uncertainties that it states.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Known,
    KnownRun,
)

FloatArray = NDArray[np.float64]

ANGLES_DEG = {"clean_0": 0.0, "clean_15": 15.0, "clean_30": 30.0, "clean_45": 45.0, "coated_0": 0.0}
COATED = 2.4  #: friction of the coated wheel over that of the clean one (paper: 2.37)
R_M, INERTIA, MASS_KG, GRAVITY = 0.05, 4e-4, 3.0, 9.81
RATE_HZ, BEFORE_S, AFTER_S = 9600.0, 0.15, 0.06
STOP_M, TIMEOUT_S = 0.3, 1.5
SKEW_S = 1.0 / 48_000.0  #: between the inputs of one converter
STEP_V = 20.0 / 2**14
SHAFT = 700.0  #: N m/rad
#: A potentiometer: volts per rad, and the pulley of the platform's.
POT_V_RAD, PULLEY_M = 5.0 / (20.0 * math.pi), 0.015


@dataclass(frozen=True)
class World:
    """One rig as it is; the analysis knows :attr:`known` of it."""

    limits: dict[str, float]
    peak_speed: float  #: of sliding, where friction is largest, m/s
    flatness: float  #: exponent of the fall on both sides
    breakaway: float
    stiffness: float  #: of the bristles, 1/m
    convection: float  #: 1/m
    scatter: float
    effective: float
    bearings: tuple[float, float, float]
    rolling: float
    roller_drag: float
    rails: tuple[float, float, float]
    rise: float
    rise_spread: float
    relaxation: float
    tilting: float
    profile_m: float
    load_spread: float
    torque_v: float  #: V of (a - b) per N m
    share_a: float
    bend_v: float  #: V per N of load, common to both gauges
    crosstalk_v: float  #: V per N of load, in the difference
    gauge_phase: float
    noise_v: float
    correlation: float  #: of neighbouring samples of the noise
    hum_v: float
    zero_v: float  #: spread of the zeros from run to run
    wander_v_s: float  #: spread of their slopes
    pot_error: tuple[float, float]  #: rad, once and twice per turn
    pot_slopes: tuple[float, float]
    pot_phase: tuple[float, float]
    pot_noise_v: float
    scale_gain: float
    rotor: float
    gearbox: float
    resistance: float
    calibration: AngleCalibration
    known: AngleRig

    def maximum(self, name: str) -> float:
        """Return the largest F_r/N of steady sliding: the limit, and what the bristles damp."""
        sliding = np.linspace(0.05, 3.0, 2951)
        steady = [friction(self, self.limits[name], v, math.inf) + damping(v) for v in sliding]
        return max(steady)


def drawn(number: int, profile_m: float | None = None) -> World:
    """Return the rig of that number."""
    rng = np.random.default_rng((4711, number))

    def about(value: float, spread: float) -> float:
        return value * float(np.exp(spread * rng.standard_normal()))

    def near(value: float, u: float) -> float:
        return value + u * float(rng.standard_normal())

    truth = {
        "effective_radius": near(0.992, 0.004), "bearing_constant": about(0.012, 0.3),
        "bearing_viscous": about(2e-4, 0.3), "bearing_load": about(1e-4, 0.3),
        "rolling_resistance": about(0.006, 0.2), "roller_drag": about(0.045, 0.2),
        "rail_constant": about(0.6, 0.4), "rail_load": about(0.01, 0.2),
        "rail_viscous": about(0.3, 0.3), "load_rise": near(0.07, 0.05),
    }  # fmt: skip
    u = {
        "effective_radius": 0.005, "bearing_constant": 3e-4, "bearing_viscous": 2e-5,
        "bearing_load": 2e-5, "rolling_resistance": 0.0015, "roller_drag": 0.012,
        "rail_constant": 0.09, "rail_load": 0.003, "rail_viscous": 0.02, "load_rise": 0.02,
    }  # fmt: skip
    known = {name: Known(near(value, u[name]), u[name]) for name, value in truth.items()}
    torque_v, slopes = about(0.49, 0.02), (near(1.0, 0.002), near(1.0, 0.002))
    scale_gain = near(1.0, 0.002)
    calibration = AngleCalibration(
        torque=Known(near(1.0, 0.0027) / torque_v, 0.0027 / torque_v),
        wheel=Known(1.0 / POT_V_RAD, 0.002 / POT_V_RAD),
        platform=Known(PULLEY_M / POT_V_RAD, 0.002 * PULLEY_M / POT_V_RAD),
        load=Known(near(1.0, 0.001) / scale_gain, 0.001),
        gauge_share=Known(0.5, 0.0035),
    )
    at_0 = rng.uniform(0.16, 0.24)
    slope = rng.uniform(0.002, 0.010)
    limits = {
        name: (at_0 + slope * degrees) * (COATED if name.startswith("coated") else 1.0)
        for name, degrees in ANGLES_DEG.items()
    }
    return World(
        limits=limits, peak_speed=about(0.5, 0.25), flatness=rng.uniform(0.03, 0.10),
        breakaway=about(0.4, 0.3), stiffness=about(450.0, 0.2), convection=about(70.0, 0.2),
        scatter=rng.uniform(0.007, 0.022), effective=truth["effective_radius"],
        bearings=(truth["bearing_constant"], truth["bearing_viscous"], truth["bearing_load"]),
        rolling=truth["rolling_resistance"], roller_drag=truth["roller_drag"],
        rails=(truth["rail_constant"], truth["rail_load"], truth["rail_viscous"]),
        rise=truth["load_rise"], rise_spread=0.02, relaxation=rng.uniform(0.0, 0.02),
        tilting=rng.uniform(0.0, 0.04),
        profile_m=rng.uniform(2e-5, 8e-5) if profile_m is None else profile_m,
        load_spread=0.01, torque_v=torque_v, share_a=near(0.5, 0.0015),
        bend_v=about(1.4e-3, 0.2), crosstalk_v=about(1.7e-4, 0.5),
        gauge_phase=rng.uniform(0.0, 2.0 * math.pi), noise_v=about(0.016, 0.3),
        correlation=rng.uniform(0.0, 0.5), hum_v=about(0.006, 0.4), zero_v=about(0.006, 0.3),
        wander_v_s=0.002, pot_error=(about(0.007, 0.3), about(0.002, 0.5)), pot_slopes=slopes,
        pot_phase=(rng.uniform(0.0, 6.28), rng.uniform(0.0, 6.28)), pot_noise_v=about(1.5e-3, 0.2),
        scale_gain=scale_gain, rotor=about(0.016, 0.1), gearbox=about(0.25, 0.15),
        resistance=about(0.165, 0.05), calibration=calibration,
        known=AngleRig(R_M, INERTIA, MASS_KG, GRAVITY, **known),
    )  # fmt: skip


def friction(w: World, limit: float, sliding: float, slid: float) -> float:
    """Return F_r/N of full sliding: largest, and equal to ``limit``, at the peak speed."""
    ratio = (abs(sliding) + 1e-3) / w.peak_speed
    hump: float = (2.0 * ratio / (1.0 + ratio * ratio)) ** (2.0 * w.flatness)
    return limit * hump * (1.0 + w.breakaway * math.exp(-max(slid, 0.0) / 0.01))


def damping(sliding: float) -> float:
    """Return what the bristles add to F_r/N: 0.1 s/m, which fades with the sliding speed."""
    return 0.1 * sliding / (1.0 + (sliding / 0.1) ** 2)


@dataclass(frozen=True)
class _Run:
    world: World
    alpha: float
    limit: float
    load_n: float
    rise: float
    voltage: float
    stop_s: float = math.inf

    def normal(self, t: float, wheel: float, x: float, mu: float) -> float:
        """Return N: what is set, its rise along the travel, settling of the ground, rollers."""
        w = self.world
        settled = w.relaxation * -math.expm1(-max(t, 0.0) / 0.2)
        lift = w.profile_m * (math.sin(18.0 * wheel) + 0.5 * math.sin(9.0 * wheel))
        level = self.load_n * (1.0 + self.rise * x - settled + w.tilting * mu)
        return max(level + 4.0e4 * lift, 0.0)  # N/m: of the ground, above its mode at 18 Hz

    def contact(self, t: float, y: FloatArray) -> tuple[float, float, float]:
        """Return F_r/N, N and sliding speed."""
        w = self.world
        _, _, _, wheel, speed, x, v, z, _ = y
        sliding = w.effective * R_M * speed - v * math.cos(self.alpha)
        mu = w.stiffness * z + damping(sliding)
        return mu, self.normal(t, wheel, x, mu), sliding

    def rates(self, t: float, y: FloatArray) -> list[float]:
        """Return the derivatives of current, rotor, wheel, platform, bristles and slid way."""
        w = self.world
        i, rotor, rotor_speed, wheel, speed, x, v, z, _ = y
        mu, n, sliding = self.contact(t, y)
        force = mu * n
        closed = 0.008 <= t < self.stop_s + 0.006
        di = ((self.voltage if closed else 0.0) - 0.222 * rotor_speed - w.resistance * i) / 2.5e-4
        if not closed:
            di = -i / 5e-4
        twist = rotor - wheel
        bent = math.copysign(max(abs(twist) - 0.005, 0.0), twist)
        torque = SHAFT * bent + (0.06 * (rotor_speed - speed) if bent else 0.0)
        turning = math.tanh(speed / 0.05)
        drag = (w.bearings[0] + w.bearings[2] * n + w.rolling * n * R_M) * turning
        drag += w.bearings[1] * speed
        ending = friction(w, self.limit, sliding, y[8]) / w.stiffness
        left = 1.0 - math.copysign(z / ending, sliding)
        dz = sliding * left - w.convection * abs(speed * R_M) * z * max(
            1.0 - (z / ending) ** 2, 0.0
        )
        axial = w.roller_drag * n
        side = abs(force * math.sin(self.alpha) + axial * math.cos(self.alpha))
        moving = math.tanh(v / 2e-3)
        rails = (w.rails[0] + w.rails[1] * (abs(n - MASS_KG * GRAVITY) + side)) * moving
        push = force * math.cos(self.alpha) - axial * math.sin(self.alpha) * moving
        beyond = max(x - 0.45, 0.0)
        dv = (push - rails - w.rails[2] * v - 8000.0 * beyond) / MASS_KG
        return [
            di, rotor_speed,
            (0.222 * 0.85 * i - w.gearbox * math.tanh(rotor_speed / 0.05) - torque) / w.rotor,
            speed, (torque - drag - w.effective * R_M * force) / INERTIA,
            v, dv, dz, abs(sliding),
        ]  # fmt: skip


def campaign(
    number: int, cells: Sequence[tuple[str, float, float]], profile_m: float | None = None
) -> list[KnownRun]:
    """Return the runs of one rig, one for each set, load in kg and voltage in V, in that order."""
    world = drawn(number, profile_m)
    rng = np.random.default_rng((815, number))
    return [
        KnownRun(_simulated(world, *cell, place, rng), world.calibration, world.known)
        for place, cell in enumerate(cells, 1)
    ]


def _solved(
    run: _Run, span_s: tuple[float, float], start: FloatArray, event: Callable[..., float] | None
) -> Any:  # scipy's own type of result is wider than what LSODA gives
    return solve_ivp(
        run.rates, span_s, start, method="LSODA", dense_output=True, events=event, rtol=1e-6,
        atol=1e-8, max_step=2e-3,
    )  # fmt: skip


def _simulated(
    world: World, name: str, load_kg: float, voltage_v: float, number: int, rng: np.random.Generator
) -> AngleRun:
    load_n = load_kg * GRAVITY * (1.0 + world.load_spread * rng.standard_normal())
    alpha = math.radians(ANGLES_DEG[name])
    drive = _Run(
        world, alpha + math.radians(0.15) * rng.standard_normal(),
        world.limits[name] * (1.0 + world.scatter * rng.standard_normal()), load_n,
        world.rise + world.rise_spread * rng.standard_normal(), voltage_v,
    )  # fmt: skip

    def at_stop(_: float, y: FloatArray) -> float:
        return float(y[5] - STOP_M)

    at_stop.terminal = True  # type: ignore[attr-defined]  # as solve_ivp asks
    start = np.zeros(9)
    start[1] = 0.005 * rng.uniform(-1.0, 1.0)
    driven = _solved(drive, (0.0, TIMEOUT_S), start, at_stop)
    stop_s = float(driven.t[-1]) + rng.uniform(0.004, 0.020)
    whole = replace(drive, stop_s=stop_s)
    end_s = stop_s + AFTER_S
    rest = _solved(whole, (float(driven.t[-1]), end_s), driven.y[:, -1], None)
    t_s = np.arange(-round(BEFORE_S * RATE_HZ), math.floor(end_s * RATE_HZ)) / RATE_HZ
    t_s += rng.uniform(0.0, 1.0 / RATE_HZ)
    t_s = t_s[t_s < end_s - 4.0 * SKEW_S]

    def states(times: FloatArray) -> FloatArray:
        clipped = np.maximum(times, 0.0)
        late = clipped > driven.t[-1]
        y = driven.sol(np.minimum(clipped, driven.t[-1]))
        y[:, late] = rest.sol(clipped[late])
        return np.asarray(y)

    y = states(t_s)
    normal, torque = np.empty(len(t_s)), np.empty(len(t_s))
    for k, t in enumerate(t_s):
        normal[k] = whole.contact(float(t), y[:, k])[1]
    twist = y[1] - y[3]
    bent = np.sign(twist) * np.maximum(np.abs(twist) - 0.005, 0.0)
    torque = SHAFT * bent + np.where(bent != 0.0, 0.06 * (y[2] - y[4]), 0.0)
    place_rad = 5.8 + 0.25 * rng.standard_normal()
    gauge_a, gauge_b = _gauges(world, t_s, torque, normal, y[3] + place_rad, rng)
    wheel = states(t_s + 2.0 * SKEW_S)[3] + place_rad
    platform = (states(t_s + 3.0 * SKEW_S)[5] + 0.09 + 5e-4 * rng.standard_normal()) / PULLEY_M
    readings = world.scale_gain * load_n / GRAVITY + 0.008 * rng.standard_normal(6)
    return AngleRun(
        label=f"{name} {load_kg:g} kg {voltage_v:g} V", set_name=name, wheel="clean",
        alpha_rad=alpha, announced_load_kg=load_kg, voltage_v=voltage_v, repeat=1, t_s=t_s,
        gauge_a_v=gauge_a, gauge_b_v=gauge_b,
        wheel_v=_potentiometer(world, 0, wheel, rng),
        platform_v=_potentiometer(world, 1, platform, rng),
        stop_s=stop_s, load_n=GRAVITY * float(np.mean(np.round(readings, 2))), number=number,
    )  # fmt: skip


def _gauges(
    w: World, t_s: FloatArray, torque: FloatArray, normal: FloatArray, wheel: FloatArray,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    turned = np.cos(wheel + w.gauge_phase)
    common = w.bend_v * normal * turned
    difference = w.torque_v * torque + w.crosstalk_v * normal * turned
    zeros = w.zero_v * rng.standard_normal(2) / math.sqrt(2.0)
    phase = rng.uniform(0.0, 2.0 * math.pi)
    volts = []
    for sign, share, zero in ((1.0, w.share_a, zeros[0]), (-1.0, 1.0 - w.share_a, zeros[1])):
        hum = sum(
            size * np.sin(2.0 * math.pi * 50.0 * k * t_s + k * phase + 0.3 * sign)
            for k, size in ((1, w.hum_v), (2, 0.2 * w.hum_v), (3, 0.3 * w.hum_v))
        )
        white = rng.standard_normal(len(t_s))
        kept = w.correlation
        noise = lfilter([math.sqrt(1.0 - kept**2)], [1.0, -kept], white) * w.noise_v
        wander = w.wander_v_s * rng.standard_normal() * t_s
        relay = 0.1 * sign * np.where(t_s > 0.008, np.exp(-np.clip(t_s - 0.008, 0, 1) / 4e-4), 0.0)
        clean = common + sign * share * difference + zero + wander + relay
        # The amplifier is a low-pass of 2 kHz.
        a = math.exp(-2.0 * math.pi * 2000.0 / RATE_HZ)
        passed = lfilter([1.0 - a], [1.0, -a], clean, zi=[a * clean[0]])[0]
        volts.append(STEP_V * np.round((passed + hum + noise) / STEP_V))
    return volts[0], volts[1]


def _potentiometer(
    w: World, which: int, turned: FloatArray, rng: np.random.Generator
) -> FloatArray:
    once, twice = w.pot_error
    phase = w.pot_phase[which]
    shown = w.pot_slopes[which] * (
        turned + once * np.sin(turned + phase) + twice * np.sin(2.0 * turned + 2.3 * phase)
    )
    wound = 2e-3 * np.round(shown / 2e-3)  # a wire-wound track: 3,100 wires a turn
    volts = POT_V_RAD * wound + w.pot_noise_v * rng.standard_normal(len(turned))
    return np.asarray(STEP_V * np.round(volts / STEP_V))
