"""A two-module robot of a second author: physics in C (`robot.c`), sensors and recordings here.

Written from the paper, `docs/physics/articulated.md`, `docs/robot.md` and `docs/recordings.md`,
without a look at rigd's simulators and analyses.
"""

from __future__ import annotations

import ctypes
import json
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from blind.recording import Recording
from blind.rig import about_rig, compiled, names
from numpy.typing import NDArray

Array = NDArray[np.float64]
SOURCE: Final = Path(__file__).with_name("robot.c")
#: wheels of a module in the order of the arrays: y is to the left
PLACES: Final = ("front right", "front left", "rear right", "rear left")
CONSTANTS: Final = names(SOURCE)
MODULE: Final = names(SOURCE, "OF_MODULE")
WHEEL: Final = names(SOURCE, "OF_WHEEL")
UNIT: Final = names(SOURCE, "OF_UNIT")
STEP: Final = 2.5e-4  # s
REST: Final = 0.5  # s
UNITS: Final = {
    "wheel_radius": ("m", 1e-4), "half_track": ("m", 5e-4), "half_wheelbase": ("m", 5e-4),
    "hinge_distance": ("m", 5e-4), "gear_ratio": ("1", 0.0), "rotor_inertia": ("kg m^2", 1e-7),
    "body_mass": ("kg", 2e-3), "body_inertia": ("kg m^2", 9e-4), "wheel_mass": ("kg", 1e-3),
    "wheel_inertia": ("kg m^2", 2.4e-6), "gravity": ("m/s^2", 0.01),
}  # fmt: skip


@dataclass
class Trial:
    """Speeds of both motors that are reached over a time and held."""

    right: float  # rad/s
    left: float  # rad/s
    ramp: float  # s
    lasting: float  # s
    level: float = 1.0  # k_lon and k_lat in this trial, over those of the robot
    sliding: float = 1.0  # mu_s and mu_d in this trial
    begin: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)  # m, m, rad of each module, off the marks


@dataclass
class Camera:
    """What a camera over the floor makes of the poses of two markers."""

    rate: float = 25.0
    latency: float = 0.02
    noise: float = 0.002  # m
    heading_noise: float = 0.0087  # rad
    scale_x: float = 1.0
    scale_y: float = 1.0
    lost: float = 0.01
    exchanged: float = 0.002
    wraps: bool = False  # headings within one turn
    offsets: list[complex] = field(default_factory=lambda: [0j, 0j])  # of each marker, m
    turned: list[float] = field(default_factory=lambda: [0.0, 0.0])  # of each marker, rad
    clock: float = 1.0
    jitter: float = 0.0  # s rms
    skew: float = 0.0  # rad between its axes
    barrel: float = 0.0  # 1/m^2
    lens_at: complex = 0.5 + 0.5j
    perspective: float = 0.0  # 1/m: the scale grows along x
    heading_late: float = 0.0  # s
    rear_late: float = 0.0  # s
    step: float = 0.0  # m
    outliers: float = 0.0  # share of frames that are off by some 5 cm
    drift: float = 0.0  # m/s along x
    hum: tuple[float, float] = (0.0, 0.0)  # m, Hz along y
    moved: float = 0.0  # rad: it is turned by so much after half of the trials
    exposure: float = 0.0  # s: a pose is the mean over so long
    gap: float = 0.0  # s in which the rear marker is not seen


@dataclass
class Motors:
    """What the sensors of the motors make of speeds and torques."""

    rate: float = 1000.0
    speed_noise: float = 1.0
    torque_noise: float = 1e-3
    torque_gain: tuple[float, float] = (1.0, 1.0)
    torque_zero: tuple[float, float] = (0.0, 0.0)
    torque_filter: float = 0.0  # Hz
    torque_late: float = 0.0
    torque_clip: float = 0.0
    torque_drift: float = 0.0  # N m/s
    torque_fade: float = 0.0  # gain per s
    speed_gain: tuple[float, float] = (1.0, 1.0)
    speed_late: float = 0.0
    speed_filter: float = 0.0
    eccentric: float = 0.0  # of the encoder's disk, on the wheel
    hum: tuple[float, float] = (0.0, 0.0)  # N m, Hz
    exchanged: bool = False
    spikes: float = 0.0  # share of torques that are wrong by some 20 mN m
    absolute: bool = False  # the torque has no sign


@dataclass
class Robot:
    """The true robot, what its file states, its sensors and its trials."""

    true: dict[str, float]
    modules: Array  # (2, quantities)
    wheels: Array  # (8, quantities)
    units: Array  # (4, quantities)
    stated: dict[str, tuple[float, float]]
    camera: Camera
    motors: Motors
    trials: list[Trial]
    seed: int
    undefined: tuple[str, ...] = ()  # parameters that have no true value in this world

    def module(self, name: str) -> Array:
        """Return a quantity of all modules, which a caller may change."""
        return self.modules[:, MODULE.index(name)]

    def wheel(self, name: str) -> Array:
        """Return a quantity of all wheels, which a caller may change."""
        return self.wheels[:, WHEEL.index(name)]

    def unit(self, name: str) -> Array:
        """Return a quantity of all units, which a caller may change."""
        return self.units[:, UNIT.index(name)]

    def truth(self) -> dict[str, tuple[float, float]]:
        """Return the least and the largest true value of each parameter that has one."""
        levels = [trial.level for trial in self.trials]
        slides = [trial.sliding for trial in self.trials]
        grips = np.outer([1, 1 + self.true["patch"], 1 + self.true["warming"]], levels)
        spread = {
            "k_lon": np.outer(self.wheel("k_lon"), grips),
            "k_lat": np.outer(self.wheel("k_lat"), grips),
            "k_roll": self.wheel("k_roll"),
            "mu_s": self.true["mu_s"] * np.outer(self.wheel("static"), slides),
            "mu_d": self.true["mu_d"] * np.outer(self.wheel("kinetic"), slides),
        }
        return {
            name: (float(values.min()), float(values.max()))
            for name, values in spread.items()
            if name not in self.undefined
        }


def draw(seed: int) -> Robot:
    """Return a right robot: realistic, and its constants within their stated uncertainties."""
    random = np.random.default_rng([148, seed])
    true = dict.fromkeys(CONSTANTS, 0.0) | {
        "gravity": 9.81, "rest_speed": 0.2, "centre_height": 0.06, "transfer_time": 0.02,
        "patch_at": 0.5, "power_speed": 0.01, "falling_speed": 0.2, "warming_time": 8.0,
        "hinge_stop": np.radians(100), "ripples": 7.0, "torque_limit": 0.05,
    }  # fmt: skip
    true["mu_d"] = random.uniform(0.45, 0.75)
    true["mu_s"] = true["mu_d"] * random.uniform(1.2, 1.6)
    size = random.uniform(0.85, 1.3)
    modules, wheels, units = (
        np.zeros((count, len(of))) for count, of in ((2, MODULE), (8, WHEEL), (4, UNIT))
    )
    of_module = {
        "mass": 3.6 * size**2 * random.uniform(0.8, 1.2), "half_track": 0.14833 * size,
        "half_wheelbase": 0.0507 * size * random.uniform(0.95, 1.3), "wheel_mass": 0.1 * size,
        "wheel_yaw": 5e-5 * size,
    }  # fmt: skip
    of_module["inertia"] = 0.0083 * of_module["mass"] * size**2 * random.uniform(0.8, 1.3)
    for name, value in of_module.items():
        modules[:, MODULE.index(name)] = value
    hinge = 0.2 * size * random.uniform(0.9, 1.2)
    modules[0, MODULE.index("behind")] = modules[1, MODULE.index("ahead")] = hinge
    load = (of_module["mass"] + 4 * of_module["wheel_mass"]) * 9.81 / 4
    of_wheel = {
        "radius": 0.04 * random.uniform(0.9, 1.15), "k_lon": 120 * random.lognormal(0, 0.2),
        "k_lat": 200 * random.lognormal(0, 0.2), "k_roll": 8e-4 * random.lognormal(0, 0.25),
        "load": load, "static": 1.0, "kinetic": 1.0,
    }  # fmt: skip
    of_wheel["k_lon"] = min(of_wheel["k_lon"], 180.0)
    for name, value in of_wheel.items():
        wheels[:, WHEEL.index(name)] = value
    gear = float(random.choice([20, 25, 30]))
    inertia = 8e-5 * random.uniform(0.7, 1.4)
    units[:, UNIT.index("wheel_inertia")] = inertia
    units[:, UNIT.index("gear")] = gear
    units[:2, UNIT.index("driven")] = 1
    units[:2, UNIT.index("rotor")] = 1e-6 * random.uniform(0.7, 1.5)
    true["kp"], true["ki"] = 5e-4 * random.uniform(0.7, 1.5), 5e-3 * random.uniform(0.5, 2)
    values = {
        "wheel_radius": of_wheel["radius"], "half_track": of_module["half_track"],
        "half_wheelbase": of_module["half_wheelbase"], "hinge_distance": hinge, "gear_ratio": gear,
        "rotor_inertia": float(units[0, UNIT.index("rotor")]), "body_mass": of_module["mass"],
        "body_inertia": of_module["inertia"], "wheel_mass": of_module["wheel_mass"],
        "wheel_inertia": inertia, "gravity": 9.81,
    }  # fmt: skip
    stated = {
        name: (value + UNITS[name][1] * float(np.clip(random.normal(), -2.2, 2.2)), UNITS[name][1])
        for name, value in values.items()
    }
    camera = Camera(
        rate=float(random.choice([20, 25, 30, 50])),
        latency=random.uniform(0.005, 0.04),
        noise=random.uniform(0.001, 0.003),
        heading_noise=np.radians(random.uniform(0.25, 0.7)),
        scale_x=1 + 0.01 * float(np.clip(random.normal(), -2, 2)),
        scale_y=1 + 0.01 * float(np.clip(random.normal(), -2, 2)),
        lost=random.uniform(0, 0.02),
        exchanged=random.uniform(0, 0.004),
        wraps=bool(random.random() < 0.5),
    )
    motors = Motors(
        rate=float(random.choice([500, 1000])),
        speed_noise=random.uniform(0.3, 1.2),
        torque_noise=random.uniform(0.5e-3, 1.5e-3),
    )
    trials = _manoeuvres(random)
    for trial in trials:
        place, heading = 0.005 * random.normal(size=2), np.radians(random.normal(size=2))
        trial.begin = (*map(float, place), *map(float, heading))
    return Robot(true, modules, wheels, units, stated, camera, motors, trials, seed)


def _manoeuvres(random: np.random.Generator) -> list[Trial]:
    """Return straight runs, ramped and stepped, and circles to both sides, also fast ones."""
    speeds = np.round(np.sort(random.uniform(90, 330, int(random.integers(3, 6)))), -1)
    trials = [Trial(v, v, 0.5, 3.0) for v in speeds.tolist()]
    steps = np.round(random.uniform(220, 480, int(random.integers(2, 5))), -1)
    trials += [Trial(v, v, 1e-3, 3.0) for v in steps.tolist()]
    for _ in range(int(random.integers(1, 3))):
        slow = float(np.round(random.uniform(60, 110), -1))
        fast = float(np.round(slow * random.uniform(1.7, 2.2)))
        lasting = float(random.choice([15, 20, 30]))
        trials += [Trial(fast, slow, 0.3, lasting), Trial(slow, fast, 0.3, lasting)]
    fast = float(np.round(random.uniform(380, 490), -1))
    trials.append(Trial(fast, fast / 2, 0.3, float(random.choice([10, 15, 20]))))
    if random.random() < 0.5:
        trials.append(Trial(fast / 2, fast, 0.3, 10.0))
    return trials


@cache
def _play() -> Any:
    function = compiled(SOURCE, "-fcx-limited-range")
    pointer = ctypes.POINTER(ctypes.c_double)
    function.restype = ctypes.c_long
    function.argtypes = [
        *[pointer] * 4,
        ctypes.c_long,
        *[pointer] * 2,
        ctypes.c_double,
        *[ctypes.c_long] * 2,
        pointer,
    ]
    return function


def drive(robot: Robot, number: int) -> Array:
    """Return the true states of one trial each ms.

    Columns: t, then x, y, heading of each module, then by unit speed and torque of the motor and
    angle of the wheels.
    """
    trial, count = robot.trials[number], len(robot.modules)
    wheels = robot.wheels.copy()
    for name in ("k_lon", "k_lat"):
        wheels[:, WHEEL.index(name)] *= trial.level
    for name in ("static", "kinetic"):
        wheels[:, WHEEL.index(name)] *= trial.sliding
    end = REST + trial.lasting
    asked = np.array([trial.right, trial.left, trial.ramp, REST, end])
    rows = round((end + 0.8) / 1e-3)
    out = np.zeros((rows, 1 + 3 * count + 6 * count))
    constants = np.array([robot.true[name] for name in CONSTANTS])
    given = [constants, robot.modules, wheels, robot.units]
    pointer = ctypes.POINTER(ctypes.c_double)
    arrays = [np.ascontiguousarray(array, dtype=float) for array in given]
    more = [asked, np.array(trial.begin)]
    _play()(
        *[array.ctypes.data_as(pointer) for array in arrays],
        count,
        *[array.ctypes.data_as(pointer) for array in more],
        STEP,
        round(1e-3 / STEP),
        rows,
        out.ctypes.data_as(pointer),
    )
    assert np.isfinite(out).all(), "the simulation ran away"
    return out


def torques(robot: Robot, number: int, truth: Array) -> tuple[Array, Array]:
    """Return the times and the rows of the motors: speed right, left, torque right, left."""
    m = robot.motors
    random = np.random.default_rng([robot.seed, 17, number])
    first = 1 + 3 * len(robot.modules)
    t = truth[:, 0]
    times = np.arange(0, t[-1], 1 / m.rate)
    found = []
    for side in range(2):
        speed, torque, angle = (truth[:, first + 3 * side + n] for n in range(3))
        if m.speed_filter:
            speed = _lag(speed, 1 - np.exp(-2 * np.pi * m.speed_filter * 1e-3))
        if m.torque_filter:
            torque = _lag(torque, 1 - np.exp(-2 * np.pi * m.torque_filter * 1e-3))
        speed = speed * (1 + m.eccentric * np.sin(angle + side)) * m.speed_gain[side]
        torque = torque * m.torque_gain[side] * (1 + m.torque_fade * t) + m.torque_zero[side]
        torque = torque + m.torque_drift * t
        found.append(
            (np.interp(times - m.speed_late, t, speed), np.interp(times - m.torque_late, t, torque))
        )
    table = np.column_stack([found[0][0], found[1][0], found[0][1], found[1][1]])
    table[:, :2] += m.speed_noise * random.normal(size=table[:, :2].shape)
    table[:, 2:] += m.torque_noise * random.normal(size=table[:, 2:].shape)
    size, frequency = m.hum
    table[:, 2:] += size * np.sin(2 * np.pi * frequency * (times + 3.7 * number))[:, None]
    spiked = random.random(size=table[:, 2:].shape) < m.spikes
    table[:, 2:] += 0.02 * spiked * random.normal(size=spiked.shape)
    if m.torque_clip:
        table[:, 2:] = np.clip(table[:, 2:], -m.torque_clip, m.torque_clip)
    if m.absolute:
        table[:, 2:] = np.abs(table[:, 2:])
    if m.exchanged:
        table[:, 2:] = table[:, [3, 2]]
    return times, table


def poses(robot: Robot, number: int, truth: Array, which: int) -> tuple[Array, Array]:
    """Return the times and the rows of one marker: x, y, heading."""
    c = robot.camera
    shared = np.random.default_rng([robot.seed, 18, number])
    t = truth[:, 0]
    phase = shared.uniform(0, 1 / c.rate)
    frames = np.arange(phase, t[-1], 1 / c.rate)
    swapped = shared.random(len(frames)) < c.exchanged
    random = np.random.default_rng([robot.seed, 19, number, which])
    seen = []
    for module in range(2):
        when = frames + c.jitter * random.normal(size=len(frames)) - (c.rear_late if module else 0)
        columns = [truth[:, 1 + 3 * module + n] for n in range(3)]
        if c.exposure:
            width = round(c.exposure / 1e-3)
            columns = [
                np.convolve(np.pad(v, width, "edge"), np.ones(width) / width, "same")[width:-width]
                for v in columns
            ]
        x, y, heading = (np.interp(when, t, column) for column in columns)
        later = np.interp(when - c.heading_late, t, columns[2])
        place = x + 1j * y + c.offsets[module] * np.exp(1j * heading)
        seen.append((place, later + c.turned[module]))
    place = np.where(swapped, seen[1 - which][0], seen[which][0])
    heading = np.where(swapped, seen[1 - which][1], seen[which][1])
    if c.moved and number >= len(robot.trials) // 2:
        place, heading = place * np.exp(1j * c.moved), heading + c.moved
    off = place - c.lens_at
    place = c.lens_at + off * (1 + c.barrel * np.abs(off) ** 2) * (1 + c.perspective * off.real)
    x = c.scale_x * (place.real + c.skew * place.imag) + c.drift * frames
    y = c.scale_y * place.imag + c.hum[0] * np.sin(2 * np.pi * c.hum[1] * frames)
    far = random.random(len(frames)) < c.outliers
    x = x + c.noise * random.normal(size=len(x)) + 0.05 * far * random.normal(size=len(x))
    y = y + c.noise * random.normal(size=len(x)) + 0.05 * far * random.normal(size=len(x))
    heading = heading + c.heading_noise * random.normal(size=len(x))
    if c.step:
        x, y = c.step * np.round(x / c.step), c.step * np.round(y / c.step)
    if c.wraps:
        heading = (heading + np.pi) % (2 * np.pi) - np.pi
    kept = random.random(len(frames)) >= c.lost
    if which == 1 and c.gap:
        middle = 0.5 * t[-1]
        kept &= ~((frames > middle) & (frames < middle + c.gap))
    times = frames * c.clock + c.latency
    return times[kept], np.column_stack([x, y, heading])[kept]


def write(robot: Robot, path: Path) -> None:
    """Write the recording: the motors in one stream, each marker in one of its own."""
    pose = {"x": "m", "y": "m", "heading": "rad"}
    streams = {
        "motors": {
            "right_speed": "rad/s",
            "left_speed": "rad/s",
            "right_torque": "N m",
            "left_torque": "N m",
        },
        "front": pose,
        "rear": pose,
    }
    begin = 1_700_000_000_000_000_000 + robot.seed % 10_000 * 86_400_000_000_000
    signals = {name: f"motors.{name}" for name in streams["motors"]} | {
        f"{marker}_{name}": f"{marker}.{name}" for marker in ("front", "rear") for name in pose
    }
    with Recording(path, begin, streams) as file:
        now = begin
        file.tell("run_start", -1, now, {"procedure": "manoeuvres", "resumed": False})
        for number, trial in enumerate(robot.trials, 1):
            truth = drive(robot, number - 1)
            tables = {
                "motors": torques(robot, number - 1, truth),
                "front": poses(robot, number - 1, truth, 0),
                "rear": poses(robot, number - 1, truth, 1),
            }
            now += 1_000_000
            parameters = {"right": trial.right, "left": trial.left}
            units = dict.fromkeys(parameters, "rad/s")
            file.tell(
                "trial_start",
                number,
                now,
                {"number": number, "repeat": 1, "parameters": parameters, "units": units},
            )
            ends = now + round(truth[-1, 0] * 1e9)
            rows = {
                name: (now + np.round(times * 1e9).astype(np.int64), table)
                for name, (times, table) in tables.items()
            }
            file.rows({n: (w[w < ends], table[w < ends]) for n, (w, table) in rows.items()})
            now = ends + 1_000_000
            file.tell("trial_end", number, now, {"complete": True, "reason": "all steps played"})
            now += 20_000_000_000
        count = len(robot.trials)
        about = about_rig(
            "articulated",
            f"robot-{robot.seed}",
            count,
            signals,
            robot.stated,
            lambda name: UNITS[name][0],
        )
        constants = json.loads(about["identify"]["constants"]) | {"certain_grip": 0.7}
        about["identify"]["constants"] = json.dumps(constants)
        units = json.loads(about["identify"]["units"]) | {"certain_grip": "1"}
        about["identify"]["units"] = json.dumps(units)
        file.end(now, count, about)


def _lag(values: Array, share: float) -> Array:
    from scipy.signal import lfilter

    filtered: Array = lfilter([share], [1, share - 1], values - values[0]) + values[0]
    return filtered
