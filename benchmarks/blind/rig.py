"""A LuGre omni-wheel rig of a second author: physics in C (`rig.c`), sensors and recordings here.

Written from the paper, `docs/physics/lugre.md` and `docs/recordings.md`, without a look at rigd's
simulators and analyses. Recordings are written by the `mcap` library.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from blind.recording import Recording
from numpy.typing import NDArray

Array = NDArray[np.float64]
SOURCE: Final = Path(__file__).with_name("rig.c")
FLAGS: Final = ("-O3", "-march=native", "-std=c11", "-fPIC", "-shared")
G: Final = 9.81  # m/s^2
STATES: Final = 13
COLUMNS: Final = 14
PARTS: Final = 10  # rows of the truth in each cycle of the control
HOME: Final = 0.002  # m
TICK: Final = 2 * np.pi / 20.25  # rad of the wheel in a turn of the motor


@cache
def names(source: Path = SOURCE, enum: str = "CONSTANTS") -> tuple[str, ...]:
    """Return the names of the list in a C source that ends with the name ``enum``."""
    text = re.sub(r"/\*.*?\*/", "", source.read_text("utf-8"), flags=re.S)
    listed = re.search(rf"enum \{{([^}}]*?)\b{enum}\s*\}}", text, re.S)
    assert listed is not None
    return tuple(name.strip().lower() for name in listed[1].split(",") if name.strip())


def compiled(source: Path, *more: str) -> Any:
    """Return the function ``play`` of a C source."""
    with tempfile.TemporaryDirectory(prefix="blind-") as folder:
        library = Path(folder, "rig.so")
        command = [
            os.environ.get("CC", "cc"),
            *FLAGS,
            *more,
            "-o",
            str(library),
            str(source),
            "-lm",
        ]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(library)).play


@cache
def _play() -> Any:
    function = compiled(SOURCE)
    pointer = ctypes.POINTER(ctypes.c_double)
    function.restype = ctypes.c_long
    function.argtypes = [
        *[pointer] * 3,
        ctypes.c_long,
        ctypes.c_double,
        ctypes.c_long,
        ctypes.c_long,
        pointer,
        ctypes.c_long,
    ]
    return function


@dataclass
class Trial:
    """One drive: a current that is held, one that changes at a place, or a ramp."""

    current: float  # A
    shape: str = "hold"
    second: float = 0.0  # A
    at: float = 0.0  # m, of a change; s, of a ramp
    lasting: float = 4.0  # s
    constants: dict[str, float] = field(default_factory=dict)  # that hold in this trial alone
    level: float = 1.0  # friction of the contact in this trial, over that of the rig
    relaxed: bool = True
    wait: float = 60.0  # s since the contact was last loaded
    clutch: bool = False  # the belt stays engaged by mistake
    rest: float = 0.5  # s
    lateral: float = 0.0  # m/s, of the bridge


@dataclass
class Sensors:
    """What the sensors make of the truth."""

    counts: float = 1024.0  # of a turn of the motor
    guide: float = 3.07e-5  # m per count
    acceleration_noise: float = 0.03
    acceleration_step: float = 0.012
    acceleration_bias: float = 0.02
    acceleration_gain: float = 1.0
    shake: float = 0.15
    current_noise: float = 0.006
    current_step: float = 0.00305
    current_zero: float = 0.0
    current_gain: float = 1.0
    delays: dict[str, float] = field(default_factory=dict)  # s, by channel
    filters: dict[str, float] = field(default_factory=dict)  # Hz, of first order
    scales: dict[str, float] = field(default_factory=dict)
    tones: dict[str, tuple[float, float]] = field(default_factory=dict)  # size, Hz
    drifts: dict[str, float] = field(default_factory=dict)  # per s of the trial
    spikes: dict[str, tuple[float, float]] = field(default_factory=dict)  # share of rows, size
    one_sided: bool = False  # all spikes upward
    clips: dict[str, float] = field(default_factory=dict)
    jitter: dict[str, float] = field(default_factory=dict)  # s rms
    stuck: dict[str, float] = field(
        default_factory=dict
    )  # share of rows that repeat the one before, in bursts
    gone: float = 0.0  # share of rows that are missing, in bursts
    missed: dict[str, float] = field(
        default_factory=dict
    )  # share of the way whose counts are lost, by turns
    wobble: dict[str, tuple[float, float, float]] = field(
        default_factory=dict
    )  # size, period in its own unit, phase
    slip: float = 0.0  # the measuring wheel slips: share of the way at 1 m/s^2
    squared: float = 0.0  # gain of the current monitor falls with the current, per A
    clock: float = 1.0
    resonance: tuple[float, float] = (0.0, 0.0)  # of the accelerometer's mount: gain, Hz
    zeros: list[float] = field(default_factory=list)  # of the current, A, by trial
    gains: list[float] = field(default_factory=list)  # of the accelerometer, by trial
    steps_at: dict[str, tuple[float, float]] = field(
        default_factory=dict
    )  # jump at s since the drive
    cross: float = 0.0  # the accelerometer also feels the current, m/s^2 per A


@dataclass
class Rig:
    """A rig, its sensors, its trials, and what its file states."""

    true: dict[str, float]
    stated: dict[str, tuple[float, float]]  # value, u; by the name in rigd
    sensors: Sensors
    trials: list[Trial]
    seed: int
    rate: float = 1000.0
    substeps: int = 4
    floor: str = "floor"
    model: str = "lugre"
    name: str = ""  # empty: by the seed

    def friction(self) -> dict[str, float]:
        """Return the true parameters by their names in rigd.

        V_s is the slip at which the Stribeck effect has fallen to 1/e, whatever its law.
        """
        k = self.true
        names = ("mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2")
        share = (np.e - 1) ** (1 / k["exponent"]) if k["lorentz"] else 1.0
        return {"V_s": k["plateau"] + k["v_s"] * share} | {name: k[name] for name in names}

    def curve(self, slip: Array) -> Array:
        """Return the true g at each slip speed in m/s."""
        k = self.true
        fallen = (np.maximum(np.abs(slip) - k["plateau"], 0) / k["v_s"]) ** k["exponent"]
        left: Array = 1 / (1 + fallen) if k["lorentz"] else np.exp(-fallen)
        return k["mu_c"] + (k["mu_s"] - k["mu_c"]) * left


CHANNELS: Final = {
    "angle": "rad", "position": "m", "acceleration": "m/s^2", "current": "A", "held": "1",
}  # fmt: skip
BASE: Final = {
    "mass": 3.9593, "load": 3.9593 * G, "radius": 0.05, "wheel_inertia": 4.5e-4,
    "motor_inertia": 1.2e-6, "gear": 20.25, "efficiency": 0.81, "torque": 0.0295,
    "back_emf": 0.0295, "resistance": 3.2, "supply": 24.0, "bandwidth": 1000.0, "no_load": 2.2e-3,
    "no_load_viscous": 1.9e-6, "bearing": 1.942e-3, "guide": 0.304, "guide_viscous": 0.0,
    "rolling": 0.009, "slope": 0.0, "drag": 0.0, "cable_spring": 0.0, "exponent": 0.5,
    "rollers": 18.0, "ripple": 0.3, "ripple_phase": 0.0, "step_at": 0.6, "patch_at": 0.5,
    "patch_width": 0.1, "wave_length": 0.2, "age_length": 1e-3, "heat_time": 20.0,
    "guide_length": 0.3, "coupling_damping": 0.05, "torque_ripples": 20.25, "fade_time": 3.0,
    "touch_time": 0.2, "flat_width": 0.2, "run_in_length": 0.1,
}  # fmt: skip
FLOORS: Final = {
    "stone": {
        "v_s": 1.9643, "mu_c": 0.12, "mu_s": 0.1205, "sigma_0": 11.451, "sigma_1": 0.0809,
        "sigma_2": 2.449, "rolling": 0.009,
    },
    "pvc": {
        "v_s": 0.0044, "mu_c": 0.12, "mu_s": 0.15, "sigma_0": 49.933, "sigma_1": 0.372,
        "sigma_2": 2.8084, "rolling": 0.022,
    },
    "paperboard": {
        "v_s": 0.817, "mu_c": 0.04, "mu_s": 0.07, "sigma_0": 54.724, "sigma_1": 0.6146,
        "sigma_2": 2.4028, "rolling": 0.009,
    },
}  # fmt: skip
SHARES: Final = {  # standard uncertainties as shares: those of the shipped rig
    "mass": 2.5e-4, "wheel_radius": 2e-3, "guide_friction": 0.05, "rolling_resistance": 0.1,
    "gravity": 1e-3, "torque_constant": 0.01, "gear_ratio": 0.0, "gear_efficiency": 0.03,
    "no_load_torque": 0.1, "no_load_viscous": 0.2, "motor_inertia": 0.1, "wheel_inertia": 0.03,
    "bearing_torque": 0.3, "roller_transitions": 0.0,
}  # fmt: skip
OF_TRUTH: Final = {
    "mass": "mass", "wheel_radius": "radius", "guide_friction": "guide",
    "rolling_resistance": "rolling", "torque_constant": "torque", "gear_ratio": "gear",
    "gear_efficiency": "efficiency", "no_load_torque": "no_load",
    "no_load_viscous": "no_load_viscous", "motor_inertia": "motor_inertia",
    "wheel_inertia": "wheel_inertia", "bearing_torque": "bearing", "roller_transitions": "rollers",
}  # fmt: skip
UNITS: Final = {
    "mass": "kg", "wheel_radius": "mm", "guide_friction": "N", "rolling_resistance": "1",
    "gravity": "m/s^2", "torque_constant": "mN m/A", "gear_ratio": "1", "gear_efficiency": "1",
    "no_load_torque": "mN m", "no_load_viscous": "N m s/rad", "motor_inertia": "kg m^2",
    "wheel_inertia": "kg m^2", "bearing_torque": "mN m", "roller_transitions": "1",
}  # fmt: skip


LATERAL: Final = {  # of the rig's lateral motion: name in rigd, unit, value, u; the shipped rig's
    "guide_lever": ("lever", "mm", 0.012, 6e-4), "guide_height": ("height", "mm", 0.25, 1e-3),
    "guide_half_span": ("half_span", "mm", 0.03, 5e-4), "row_distance": ("rows", "mm", 0.04, 5e-4),
    "mass_offset": ("offset", "mm", -0.012, 5e-4), "bearing_spacing": ("spacing", "mm", 0.04, 5e-4),
    "bearing_overhang": ("overhang", "mm", 0.03, 5e-4),
}  # fmt: skip


def draw(seed: int) -> Rig:
    """Return a right rig: realistic, and its constants within their stated uncertainties."""
    random = np.random.default_rng([48, seed])
    floor = ("stone", "pvc", "paperboard")[int(random.integers(3))]
    true = {name: 0.0 for name in names()} | BASE | FLOORS[floor]
    level = random.uniform(0.75, 1.6)
    true["mu_c"] *= level
    true["mu_s"] *= level
    true["v_s"] *= random.lognormal(0, 0.4)
    for name, width in (("sigma_0", 0.35), ("sigma_1", 0.35), ("sigma_2", 0.15), ("rolling", 0.15)):
        true[name] *= random.lognormal(0, width)
    mass = random.uniform(2.0, 4.5)
    true["guide"] *= mass / true["mass"] * random.uniform(0.7, 1.3)
    true["bearing"] *= mass / true["mass"]
    true["mass"] = mass
    true["radius"] = random.uniform(0.044, 0.056)
    true["wheel_inertia"] *= random.uniform(0.7, 1.4)
    true["torque"] *= random.uniform(0.93, 1.07)
    true["back_emf"] = true["torque"]
    true["efficiency"] = random.uniform(0.76, 0.86)
    true["rollers"] = float(random.choice([14, 16, 18, 20]))
    true["ripple"] = random.uniform(0.0, 0.4)
    true["ripple_phase"] = random.uniform(0, 2 * np.pi)
    stated = {}
    for name, share in SHARES.items():
        value = G if name == "gravity" else true[OF_TRUTH[name]]
        # a stated value is off by a draw from its uncertainty
        stated[name] = (
            value * (1 + share * float(np.clip(random.normal(), -2.2, 2.2))),
            share * value,
        )
    true["load"] = true["mass"] * G - true["guide"] * random.uniform(-1, 1) * 0.9
    true["slope"] = 0.01 * random.normal()
    true["drag"] = abs(0.02 * random.normal())
    sensors = Sensors(
        counts=float(random.choice([500, 1000, 1024, 2048, 4096])),
        guide=float(random.choice([1e-5, 2e-5, 3.07e-5, 5e-5])),
        acceleration_noise=random.uniform(0.015, 0.06),
        acceleration_step=float(random.choice([0.003, 0.012, 0.024])),
        acceleration_bias=0.03 * random.normal(),
        acceleration_gain=1 + 0.01 * random.normal(),
        shake=random.uniform(0, 0.2),
        current_noise=random.uniform(0.002, 0.01),
        current_step=float(random.choice([0.001, 0.003, 0.005])),
        current_zero=0.0015 * random.normal(),
        delays={"angle": 3e-4 * abs(random.normal()), "position": 3e-4 * abs(random.normal())},
    )
    least = (true["rolling"] * mass * G + true["guide"]) * true["radius"] + true["bearing"]
    start = (least / (true["efficiency"] * true["gear"]) + true["no_load"]) / true["torque"]
    count = int(random.integers(6, 12))
    currents = np.round(np.linspace(start * 1.25, random.uniform(1.2, 1.5), count), 3)
    order = random.choice(["up", "down", "random", "random with a repeat"])
    if order == "down":
        currents = currents[::-1]
    elif order != "up":
        random.shuffle(currents)
    trials = [Trial(float(c)) for c in currents]
    if order == "random with a repeat":
        trials.append(Trial(trials[0].current))
    if random.random() < 0.3:  # tests that brake by the motor
        for n in range(int(random.integers(1, 4))):
            first = float(np.round(random.uniform(0.5, 1.3), 2))
            trials.insert(
                2 * n,
                Trial(first, "change", -float(np.round(random.uniform(0.4, 1.0), 2)), 0.45, 1.0),
            )
    rate = float(random.choice([1000, 1000, 1000, 2000, 500]))
    return Rig(true, stated, sensors, trials, seed, rate, floor=floor)


def draw_lateral(seed: int) -> Rig:
    """Return a right rig that drives while its bridge moves sideways: eight trials."""
    rig = draw(500_000 + seed)
    random = np.random.default_rng([49, seed])
    for name, (of, _unit, value, u) in LATERAL.items():
        true = value * random.uniform(0.85, 1.2)
        rig.true[of] = true
        rig.stated[name] = (true + u * float(np.clip(random.normal(), -2.2, 2.2)), u)
    rig.true["roller_dry"] = random.uniform(0.012, 0.045)
    rig.true["roller_viscous"] = random.uniform(0.01, 0.06)
    rig.true["lifted_rubs_not"] = float(random.random() < 0.3)
    # Eq. 26 locks itself where 2 s c / j reaches 1 (docs/physics/lugre.md, section 1)
    most = (rig.true["roller_dry"] + 0.65 * rig.true["roller_viscous"]) * 2 * rig.true["height"]
    share = min(1.0, 0.75 * rig.true["rows"] / most)
    rig.true["roller_dry"] *= share
    rig.true["roller_viscous"] *= share
    rig.model, rig.rate, rig.substeps = "lugre-lateral", 1000.0, 4
    least = min(trial.current for trial in rig.trials)
    currents = np.round([max(0.5, 1.6 * least), random.uniform(1.1, 1.5)], 2)
    speeds = np.round([random.uniform(0.18, 0.3), random.uniform(0.45, 0.65)], 2)
    rig.trials = [
        Trial(float(current), lateral=float(sign * speed))
        for sign in (1, -1)
        for speed in speeds
        for current in currents
    ]
    return rig


def drive(rig: Rig, number: int, substeps: int | None = None) -> Array:
    """Return the true states of one trial, ten rows for each cycle, in SI.

    Columns: t, phase, engaged, reference, current, angle of the motor and of the wheel (both at the
    wheel), speed of the wheel, x, v, a, deflection of the bristles, traction.
    """
    trial = rig.trials[number]
    k = rig.true | trial.constants
    for name in ("mu_c", "mu_s", "sigma_2"):
        k[name] = k[name] * trial.level
    constants = np.array([k[name] for name in names()])
    random = np.random.default_rng([rig.seed, 7, number])
    y = np.zeros(STATES)
    y[2] = -0.8 * k["mu_c"] / k["sigma_0"]
    y[4] = HOME + 2e-4 * random.normal()
    y[5] = y[7] = random.uniform(0, 40)
    y[8] = trial.wait
    phases = []
    if trial.relaxed:
        phases.append([1, 0, 1, 0.3, 10, 1.2, np.inf, 0, 0, 0])
    held = 1.0 if trial.clutch else 0.0
    phases.append([1, 0, 0, 0, 0, 0.3, np.inf, 0, 1, 0])
    phases.append([held, 0, 0, 0, 0, trial.rest, np.inf, 0, 1, 0])
    aside = trial.lateral
    if aside:  # the bridge first gets its speed
        phases.append([held, 0, 0, 0, 0, abs(aside) / 5 + 0.07, np.inf, 0, 1, aside])
    if trial.shape == "hold":
        lasting = 0.46 / abs(aside) if aside else trial.lasting
        phases.append([held, 0, 0, trial.current, 0, lasting, 1.15, 0, 2, aside])
    elif trial.shape == "change":
        change = [held, 0, 2, trial.current, trial.lasting, 6, trial.at, trial.second, 2, aside]
        phases.append(change)
    else:
        ramp = [held, 0, 3, trial.current, trial.at, trial.lasting, 1.15, trial.second, 2, aside]
        phases.append(ramp)
    phases.append([1, 0, 0, 0, 0, 0.25, np.inf, 0, 1, 0])
    played = np.array(phases, dtype=np.float64)
    most = int(12 * rig.rate * PARTS)
    rows = np.empty((most, COLUMNS))
    pointers = [
        item.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        for item in (constants, y, played, rows)
    ]
    steps = substeps or max(1, int(rig.substeps * 1000 / rig.rate))
    n = _play()(*pointers[:3], len(played), 1 / rig.rate, PARTS, steps, pointers[3], most)
    assert n > 0, "a trial takes too long"
    return rows[:n]


def measure(rig: Rig, number: int, truth: Array) -> dict[str, Array]:
    """Return the samples of one trial by channel, `time` and `held` among them; SI."""
    s = rig.sensors
    random = np.random.default_rng([rig.seed, 11, number])
    fine = truth[:, 0]
    time = fine[::PARTS].copy()
    start = float(fine[np.argmax(truth[:, 1] == truth[-1, 1] - 1)])
    held = truth[::PARTS, 2].copy()
    wheel, x, v, a = truth[:, 6], truth[:, 8], truth[:, 9], truth[:, 10]
    rollers = rig.true["rollers"]
    raw = {
        "angle": truth[:, 5].copy(),
        "position": x.copy(),
        "acceleration": a + s.shake * v * np.sin(2 * rollers * wheel + 1.0),
        "current": truth[:, 4].copy(),
    }
    if s.resonance[0]:
        raw["acceleration"] = raw["acceleration"] + _ring(a, fine[1] - fine[0], *s.resonance)
    raw["acceleration"] = raw["acceleration"] + s.cross * truth[:, 4]
    raw["position"] = raw["position"] - s.slip * np.cumsum(np.abs(a) * v) * (fine[1] - fine[0])
    for name, (size, period, phase) in s.wobble.items():
        raw[name] = raw[name] + size * np.sin(2 * np.pi * raw[name] / period + phase)
    for name, share in s.missed.items():
        way = np.abs(np.diff(raw[name], prepend=raw[name][0]))
        unit = 0.05 if name == "angle" else 0.002
        lost = np.zeros(len(fine))
        for place in np.flatnonzero(random.random(len(fine)) < share * way / unit):
            lost[place:] += unit
        raw[name] = raw[name] - lost
    out: dict[str, Array] = {"time": time, "held": held}
    if rig.model == "lugre-lateral":
        raw["lateral"] = truth[:, 13].copy()
    for name, values in raw.items():
        signal = values
        if name in s.filters:
            share = 1 - np.exp(-2 * np.pi * s.filters[name] * (fine[1] - fine[0]))
            signal = _lag(signal, share)
        when = (
            time - s.delays.get(name, 0.0) + s.jitter.get(name, 0.0) * random.normal(size=len(time))
        )
        sampled = np.interp(when, fine, signal)
        out[name] = sampled
    current = (
        out["current"] * (s.current_gain - s.squared * np.abs(out["current"])) + s.current_zero
    )
    if s.zeros:
        current = current + s.zeros[number]
    out["current"] = _round(
        current + s.current_noise * random.normal(size=len(time)), s.current_step
    )
    gain = s.acceleration_gain * (s.gains[number] if s.gains else 1.0)
    acceleration = gain * out["acceleration"] + s.acceleration_bias
    out["acceleration"] = acceleration + s.acceleration_noise * random.normal(size=len(time))
    for name, (size, frequency) in s.tones.items():
        out[name] = out[name] + size * np.sin(2 * np.pi * (frequency * (time + 13.7 * number)))
    for name, rate in s.drifts.items():
        out[name] = out[name] + rate * np.maximum(time - start, 0)
    for name, (when_s, size) in s.steps_at.items():
        out[name] = out[name] + size * (time - start > when_s)
    for name, clip in s.clips.items():
        out[name] = np.clip(out[name], -clip, clip)
    out["acceleration"] = _round(out["acceleration"], s.acceleration_step)
    if "lateral" in out:
        out["lateral"] = _round(out["lateral"] + 2e-4 * random.normal(size=len(time)), 1e-4)
    out["angle"] = _round(out["angle"], TICK / s.counts / (rig.true["gear"] / 20.25))
    out["position"] = _round(out["position"], s.guide)
    for name, scale in s.scales.items():
        out[name] = out[name] * scale
    for name, (share, size) in s.spikes.items():
        hit = random.random(len(time)) < share
        side = 1.0 if s.one_sided else random.choice([-1.0, 1.0], size=len(time))
        out[name] = out[name] + hit * size * side
    for name, share in s.stuck.items():
        for place in np.flatnonzero(random.random(len(time)) < share / 15):
            out[name][place : place + 15] = out[name][place]
    if s.gone:
        kept = np.ones(len(time), dtype=bool)
        for place in np.flatnonzero(random.random(len(time)) < s.gone / 8):
            kept[place : place + int(random.integers(2, 15))] = False
        out = {name: values[kept] for name, values in out.items()}
    out["time"] = out["time"] * s.clock
    return out


def write(rig: Rig, path: Path) -> None:
    """Write the recording as another program would: all channels in one stream, and the events."""
    channels = CHANNELS | ({"lateral": "m/s"} if rig.model == "lugre-lateral" else {})
    begin = 1_700_000_000_000_000_000 + rig.seed % 10_000 * 86_400_000_000_000
    with Recording(path, begin, {"card": channels}) as file:
        now = begin
        file.tell("run_start", -1, now, {"procedure": "currents", "resumed": False})
        rolling = rig.stated["rolling_resistance"][0]
        for number, trial in enumerate(rig.trials, 1):
            samples = measure(rig, number - 1, drive(rig, number - 1))
            times = now + 1_000_000 + np.round(samples["time"] * 1e9).astype(np.int64)
            parameters: dict[str, Any] = {
                "floor": rig.floor,
                "current": trial.current,
                "rolling_resistance": rolling,
            }
            units = {"current": "A", "rolling_resistance": "1"}
            if trial.lateral:
                parameters["lateral_speed"] = abs(trial.lateral)
                parameters["direction"] = "positive" if trial.lateral > 0 else "negative"
                units["lateral_speed"] = "m/s"
            file.tell(
                "trial_start",
                number,
                int(times[0]),
                {"number": number, "repeat": 1, "parameters": parameters, "units": units},
            )
            file.rows({"card": (times, np.column_stack([samples[name] for name in channels]))})
            now = int(times[-1]) + 1_000_000
            file.tell("trial_end", number, now, {"complete": True, "reason": "all steps played"})
            now += 20_000_000_000
        signals = {
            "wheel_angle": "card.angle",
            "carriage_position": "card.position",
            "acceleration": "card.acceleration",
            "motor_current": "card.current",
            "carriage_held": "card.held",
        }
        if "lateral" in channels:
            signals["lateral_speed"] = "card.lateral"
        about = about_rig(
            rig.model,
            rig.name or f"blind-{rig.seed}",
            len(rig.trials),
            signals,
            rig.stated,
            unit_of,
        )
        about["parameters"] = {"floor": rig.floor}
        about["identify"]["group_by"] = json.dumps(["floor"])
        file.end(now, len(rig.trials), about)


def about_rig(
    model: str,
    rig: str,
    trials: int,
    signals: dict[str, str],
    stated: dict[str, tuple[float, float]],
    unit: Callable[[str], str],
) -> dict[str, dict[str, str]]:
    """Return the metadata of a recording; each constant of ``stated`` has a value and u."""
    uncertainties = {name: {"is_share": False, "size": u} for name, (_, u) in stated.items()}
    return {
        "run": {"procedure": "currents", "rig": rig, "mode": "real", "trials": str(trials)},
        "identify": {
            "model": model,
            "signals": json.dumps(signals),
            "group_by": "[]",
            "units": json.dumps({name: unit(name) for name in stated}),
            "constants": json.dumps({name: value for name, (value, _) in stated.items()}),
            "uncertainties": json.dumps(uncertainties),
        },
    }


def unit_of(name: str) -> str:
    """Return the unit of a constant of the rig."""
    return UNITS[name] if name in UNITS else LATERAL[name][1]


def _round(values: Array, step: float) -> Array:
    return np.round(values / step) * step if step else values


def _lag(values: Array, share: float) -> Array:
    from scipy.signal import lfilter

    filtered: Array = lfilter([share], [1, share - 1], values - values[0]) + values[0]
    return filtered


def _ring(values: Array, step: float, gain: float, frequency: float) -> Array:
    from scipy.signal import bilinear, lfilter

    w = 2 * np.pi * frequency
    b, a = bilinear([0.0, 0.0, w * w], [1, 0.06 * w, w * w], 1 / step)
    ringing: Array = gain * (lfilter(b, a, values) - values)
    return ringing
