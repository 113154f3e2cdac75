"""Articulated robots drawn at random within what is realistic, driven in manoeuvres of their own.

A number gives one robot: its contacts, its mass with what it carries, its camera and its sensors,
and between which speeds it is driven. Its rig file states each constant as a person has measured
it: as far off as its stated uncertainty has it. Both modules have the same sizes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML
from support.lugre.random_rigs import number_of, replaced, with_unit

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.engine.run.result import RunResult
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder

PROCEDURE: Final = "robot_manoeuvres"
NAMES: Final = ("k_lon", "k_lat", "k_roll", "mu_d", "mu_s")
_ROBOTS: Final = 13  #: sent through the generator beside the number
#: Standard deviations of logarithms: robots and floors differ by so much.
CONTACT: Final = {"longitudinal": 0.2, "lateral": 0.2, "rolling": 0.25}
KINETIC: Final = 0.12
STATIC: Final = (1.2, 1.9)  #: over the kinetic coefficient, evenly
LOAD: Final = 0.15  #: of the mass of the bodies, which stands on the scale with what they carry
STIFFEST: Final = 180.0  #: N s/m, for the step of the simulated robot
SENSORS: Final = {
    ("camera", "position_noise"): 0.4, ("camera", "heading_noise"): 0.4,
    ("camera", "latency"): 0.5, ("motor_sensors", "speed_noise"): 0.4,
    ("motor_sensors", "torque_noise"): 0.4, ("placing", "position"): 0.3,
}  # fmt: skip
SCALE: Final = 0.007  #: of the camera, along each axis
LOST, EXCHANGED = 0.03, 0.004  #: shares of frames, at most
#: The stated constants: where they stand in a module, and their standard uncertainty in that unit,
#: or as a share if it is negative. That of the bodies' mass is 2 g.
SIZES: Final = {
    ("wheels", "radius"): 0.1, ("half_track",): 0.5, ("half_wheelbase",): 0.5,
    ("body_inertia",): -0.03, ("wheels", "mass"): 1e-3, ("wheels", "spin_inertia"): -0.03,
}  # fmt: skip


@dataclass(frozen=True)
class RandomRobot:
    """Files of one robot, and the parameters of its contacts in SI by rigd's names."""

    number: int
    rig: Path
    procedure: Path
    truth: Mapping[str, float]

    def record(self, output: Path, seed: int | None = None) -> RunResult:
        """Play and record its manoeuvres with the noise of ``seed`` (default: one of its own)."""
        rig, source = load_rig(self.rig), load_procedure(self.procedure)
        procedure = compile_procedure(source, rig, {})
        seed = 1 + self.number if seed is None else seed
        request = RunRequest(procedure, source.file.text, rig, seed, output=output)
        return perform(request, Control()).result


def random_robot(
    number: int, folder: Path, changes: Mapping[str, Any] | None = None
) -> RandomRobot:
    """Write the files of the robot with this number to ``folder``, and return it.

    ``changes`` are texts of the rig file that stand there in place of others.
    """
    random = np.random.default_rng((_ROBOTS, number))
    shipped = shipped_folder("configs")
    plant = YAML().load(shipped / "plants" / "articulated.yaml")

    def times(node: Any, name: str, log_sd: float, most: float = np.inf) -> None:
        value = number_of(node[name]) * float(np.exp(log_sd * random.standard_normal()))
        node[name] = with_unit(node[name], min(value, most))

    modules = list(plant["modules"].values())
    front, rear = modules
    for name, log_sd in CONTACT.items():
        times(front["contact"], name, log_sd, STIFFEST if name == "longitudinal" else np.inf)
        rear["contact"][name] = front["contact"][name]
    times(plant["friction"], "kinetic", KINETIC)
    friction = plant["friction"]
    friction["static"] = number_of(friction["kinetic"]) * float(random.uniform(*STATIC))
    for (group, name), log_sd in SENSORS.items():
        times(plant[group], name, log_sd)
    camera = plant["camera"]
    for axis in ("scale_x", "scale_y"):
        camera[axis] = f"{100 * SCALE * random.standard_normal()!r} %"
    camera["lost"] = f"{100 * random.uniform(0.0, LOST)!r} %"
    camera["exchanged"] = f"{100 * random.uniform(0.0, EXCHANGED)!r} %"
    stated = number_of(front["body_mass"]) * float(np.exp(LOAD * random.standard_normal()))
    mass = stated + 2e-3 * random.standard_normal()
    for module in modules:
        module["body_mass"] = f"{mass!r} kg"
    for path, u in SIZES.items():
        value = _at(front, path)
        off = u * random.standard_normal() if u > 0.0 else -u * value * random.standard_normal()
        for module in modules:
            _set(module, path, value + off)
    arm = 0.5 * random.standard_normal()
    for module, name in ((front, "hinge_behind"), (rear, "hinge_ahead")):
        module[name] = with_unit(module[name], number_of(module[name]) + arm)
    plant["gravity"] = with_unit(plant["gravity"], 9.81 + 0.01 * random.standard_normal())
    times(plant["drive"], "rotor_inertia", 0.1)
    YAML().dump(plant, folder / "plant.yaml")
    rig = replaced(
        (shipped / "sim_articulated.yaml").read_text("utf-8"),
        {
            "parameters: plants/articulated.yaml": "parameters: plant.yaml",
            "body_mass: {value: 3.6 kg,": f"body_mass: {{value: {stated!r} kg,",
            **(changes or {}),
        },
    )
    (folder / "rig.yaml").write_text(rig, "utf-8")
    text = (shipped_folder("procedures") / f"{PROCEDURE}.yaml").read_text("utf-8")
    begin, end = text.index("sweep:"), text.index("\ntrial:")
    text = f"{text[:begin]}{_sweep(random)}{text[end:]}"
    (folder / "procedure.yaml").write_text(text, "utf-8")
    truth = {
        "k_lon": number_of(front["contact"]["longitudinal"]),
        "k_lat": number_of(front["contact"]["lateral"]),
        "k_roll": 1e-3 * number_of(front["contact"]["rolling"]),  # mm
        "mu_d": number_of(friction["kinetic"]),
        "mu_s": number_of(friction["static"]),
    }
    return RandomRobot(number, folder / "rig.yaml", folder / "procedure.yaml", truth)


def _sweep(random: np.random.Generator) -> str:
    """Return a sweep: straight runs, ramped and stepped, circles to both sides, and a fast one."""
    trials: list[tuple[float, float, float, float]] = []
    for _ in range(4):
        speed = random.uniform(80.0, 400.0)
        trials.append((speed, speed, 0.5, 3.0))
    for _ in range(3):
        speed = random.uniform(200.0, 500.0)
        trials.append((speed, speed, 1e-3, 3.0))
    for side in (0, 1, int(random.integers(2))):
        outer = random.uniform(100.0, 230.0)
        pair = (outer, outer * random.uniform(0.4, 0.7))
        trials.append((pair[side], pair[1 - side], 0.3, random.uniform(15.0, 30.0)))
    outer = random.uniform(400.0, 500.0)
    trials.append((outer, 0.5 * outer, 0.3, random.uniform(8.0, 15.0)))
    units = {"right": "rad/s", "left": "rad/s", "ramp_time": "s", "duration": "s"}
    columns = zip(units.items(), zip(*trials, strict=True), strict=True)
    lines = [
        f"    {name}: [{', '.join(f'{value:.3f} {unit}' for value in values)}]\n"
        for (name, unit), values in columns
    ]
    return f"sweep:\n  zip:\n{''.join(lines)}"


def _at(module: Any, path: tuple[str, ...]) -> float:
    for name in path:
        module = module[name]
    return number_of(module)


def _set(module: Any, path: tuple[str, ...], value: float) -> None:
    *parents, name = path
    for parent in parents:
        module = module[parent]
    module[name] = with_unit(module[name], value)
