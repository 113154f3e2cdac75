"""LuGre rigs drawn at random within what is realistic, and their true constants, which rigd gets.

A number gives one rig: friction of its floor, masses, drag, drive, vibration, noise of its sensors,
and where it stands at the start. Its rig file and its procedure hold the constants that a person
would have measured, without an error: intervals do not contain one (docs/identification.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from support.recordings.altered import Content

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.engine.run.result import RunResult
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder

FLOORS: Final = ("stone", "pvc", "paperboard")
PROCEDURE: Final = "constant_current"
#: Of its sweep.
PAPER_CURRENTS: Final = "{from: 0.15 A, to: 1.5 A, step: 0.15 A}"
#: Sent through the generator beside the number, so that a rig is not the seed of anything else.
_RIGS: Final = 7
_CONSTANTS: Final = 11  #: the same, for what a person measured of the constants
#: How far one rig lies from the next, as the standard deviation of the logarithm of each value.
#: Friction: surfaces of one kind, at other temperatures, loads and ages. The rest: tolerances, and
#: the weights that a person puts on. Drive: 5 % is what data sheets of motors and gears allow.
FRICTION: Final = {
    "stribeck_speed": 0.5,
    "sigma_0": 0.25,
    "sigma_1": 0.25,
    "sigma_2": 0.10,
    "rolling": 0.15,
}
MU: Final = 0.15  #: of mu_c and mu_s together
RISE: Final = 0.4  #: of mu_s / mu_c - 1
OTHERS: Final = {
    ("carriage", "mass"): 0.10,
    ("carriage", "guide", "dry"): 0.15,
    ("wheel", "radius"): 0.03,
    ("wheel", "inertia"): 0.10,
    ("wheel", "force_ripple"): 0.25,
    ("drive", "torque_constant"): 0.05,
    ("drive", "resistance"): 0.05,
    ("drive", "efficiency"): 0.05,
    ("drive", "no_load_dry"): 0.15,
    ("sensors", "accelerometer", "noise"): 0.25,
    ("sensors", "accelerometer", "shake"): 0.25,
    ("sensors", "current_monitor", "noise"): 0.25,
}
BIAS_M_S2: Final = 0.02  #: of the accelerometer: 0.1 degrees of tilt
#: Forces over the load, of a floor.
NORMALISED: Final = ("mu_coulomb", "mu_static", "sigma_0", "sigma_1", "sigma_2")
#: What no person states; docs/identification.md says how large output error takes it to be.
DRAG_N_S_M: Final = 0.05  #: of a cable
REST_CURRENT_A: Final = 3e-3  #: that flows while the drive is set to 0


@dataclass(frozen=True)
class RandomRig:
    """Files of one rig on one floor, and the parameters of its friction in SI by rigd's names."""

    number: int
    floor: str
    rig: Path
    procedure: Path
    truth: Mapping[str, float]

    def friction(self, slip_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return g at ``slip_m_s`` (corrected Eq. 6)."""
        decay = np.exp(-np.sqrt(slip_m_s / self.truth["V_s"]))
        rise = self.truth["mu_s"] - self.truth["mu_c"]
        return np.asarray(self.truth["mu_c"] + rise * decay)

    def record(self, output: Path, seed: int) -> RunResult:
        """Play and record the paper's sweep with the noise of ``seed``."""
        rig, source = load_rig(self.rig), load_procedure(self.procedure)
        procedure = compile_procedure(source, rig, {"floor": self.floor})
        request = RunRequest(procedure, source.file.text, rig, seed, output=output)
        return perform(request, Control()).result


def random_rig(
    number: int,
    floor: str,
    folder: Path,
    *,
    friction: Mapping[str, float] | None = None,
    currents: str = PAPER_CURRENTS,
    start: int | None = None,
) -> RandomRig:
    """Write the files of the rig with this number to ``folder``, and return it; 0 is as shipped.

    ``friction`` are values of the floor to be had instead (names as in ``plants/lugre.yaml``, SI),
    ``currents`` the currents of its trials as a sweep is written, ``start`` the number that draws
    where it stands at the start and the zeros of its card (default: its own).
    """
    random = np.random.default_rng((_RIGS, number))
    spread = 1.0 if number else 0.0
    shipped = shipped_folder("configs")
    plant = YAML().load(shipped / "plants" / "lugre.yaml")

    def factor(log_sd: float) -> float:
        return float(np.exp(spread * log_sd * random.standard_normal()))

    for path, log_sd in OTHERS.items():
        scale(plant, path, factor(log_sd))
    accelerometer = plant["sensors"]["accelerometer"]
    tilt = spread * BIAS_M_S2 * random.standard_normal()
    accelerometer["bias"] = f"{number_of(accelerometer['bias']) + tilt!r} m/s^2"
    surface = plant["floors"][floor]
    for name, log_sd in FRICTION.items():
        scale(surface, (name,), factor(log_sd))
    coulomb = number_of(surface["mu_coulomb"])
    rise = (number_of(surface["mu_static"]) / coulomb - 1.0) * factor(RISE)
    surface["mu_coulomb"] = coulomb * factor(MU)
    surface["mu_static"] = surface["mu_coulomb"] * (1.0 + rise)
    surface |= {name: with_unit(surface[name], value) for name, value in (friction or {}).items()}
    truth = {
        "V_s": number_of(surface["stribeck_speed"]),
        "mu_c": number_of(surface["mu_coulomb"]),
        "mu_s": number_of(surface["mu_static"]),
        **{name: number_of(surface[name]) for name in ("sigma_0", "sigma_1", "sigma_2")},
    }
    lift = spread * random.uniform(-1.0, 1.0) * _guide_friction_n(plant) / _weight_n(plant)
    for name in (*NORMALISED, "rolling"):  # shares of a load that no person knows better
        scale(surface, (name,), 1.0 - lift)
    carriage = plant["carriage"]
    drag = spread * DRAG_N_S_M * abs(random.standard_normal())
    carriage["guide"]["viscous"] = f"{drag / _guide_load_n(plant)!r} s/m"
    YAML().dump(plant, folder / "plant.yaml")
    (folder / "rig.yaml").write_text(
        _rig_text(shipped, plant, number if start is None else start), "utf-8"
    )
    (folder / "procedure.yaml").write_text(_procedure_text(surface, currents), "utf-8")
    return RandomRig(number, floor, folder / "rig.yaml", folder / "procedure.yaml", truth)


def measured(path: Path, number: int, floor: str) -> Path:
    """Return a copy of the recording whose constants are as far off as their uncertainties.

    A current flows at rest, which the monitor shows and which is taken for its zero: the readings
    are off while the drive is on. Each floor has draws of its own: with the same gravity on all
    three, their misses would be one.
    """
    random = np.random.default_rng((_CONSTANTS, number, FLOORS.index(floor)))
    content = Content.of(path)
    constants = content.plan("constants")
    for name, stated in sorted(content.plan("uncertainties").items()):
        scale = abs(constants[name]) if stated["is_share"] else 1.0
        constants[name] += stated["size"] * scale * random.standard_normal()
    content.set_plan("constants", constants)
    rows = content.rows["wheel_servo"]
    driven = np.append(0.0, rows["current_setpoint"][:-1]) != 0.0  # a row's setpoint acts behind it
    rows["current"] += REST_CURRENT_A * random.standard_normal() * driven
    return content.write(path.with_name("measured.mcap"))


def _rig_text(shipped: Path, plant: Mapping[str, Any], start: int) -> str:
    mass, friction_n = number_of(plant["carriage"]["mass"]), _guide_friction_n(plant)
    wheel, drive = plant["wheel"], plant["drive"]
    bearings = wheel["bearings"]
    spacing, overhang = number_of(bearings["spacing"]), number_of(bearings["overhang"])
    load_n = _weight_n(plant) * (spacing + 2 * overhang) / spacing  # of both bearings, Eq. 48
    bearing_mn_m = number_of(bearings["dry"]) * number_of(bearings["pitch_diameter"]) / 2 * load_n
    constants = {
        "moving_mass": ("3.9593 kg", f"{mass!r} kg"),
        "wheel_radius": ("50 mm", wheel["radius"]),
        "guide_friction": ("0.304 N", f"{friction_n!r} N"),
        "torque_constant": ("29.5 mN m/A", drive["torque_constant"]),
        "gear_efficiency": ("0.81", drive["efficiency"]),
        "no_load_torque": ("2.2 mN m", drive["no_load_dry"]),
        "wheel_inertia": ("4.5e-4 kg m^2", wheel["inertia"]),
        "bearing_torque": ("1.942 mN m", f"{bearing_mn_m!r} mN m"),
    }
    return replaced(
        (shipped / "sim_lugre.yaml").read_text("utf-8"),
        {"parameters: plants/lugre.yaml": f"parameters: plant.yaml\n  individual: {start}"}
        | {f"{name}: {{value: {old},": f"{name}: {{value: {new},"
           for name, (old, new) in constants.items()},
    )  # fmt: skip


def _guide_load_n(plant: Mapping[str, Any]) -> float:
    """Return the load on the guide, by which its friction is one of the carriage (Eq. 23)."""
    guide = plant["carriage"]["guide"]
    arm = abs(number_of(guide["contact_arm"]) - number_of(guide["mass_arm"]))
    return _weight_n(plant) * arm / number_of(guide["half_span"])


def _guide_friction_n(plant: Mapping[str, Any]) -> float:
    return number_of(plant["carriage"]["guide"]["dry"]) * _guide_load_n(plant)


def _weight_n(plant: Mapping[str, Any]) -> float:
    return number_of(plant["carriage"]["mass"]) * number_of(plant["gravity"])


def _procedure_text(surface: Mapping[str, Any], currents: str) -> str:
    text = (shipped_folder("procedures") / f"{PROCEDURE}.yaml").read_text("utf-8")
    line = next(line for line in text.splitlines() if "values: {stone: 0.009" in line)
    values = ", ".join(f"{name}: {number_of(surface['rolling'])!r}" for name in FLOORS)
    return replaced(text, {line: f"    values: {{{values}}}", PAPER_CURRENTS: currents})


def replaced(text: str, changes: Mapping[str, str]) -> str:
    for old, new in changes.items():
        if text.count(old) != 1:
            raise ValueError(f"{old!r} stands {text.count(old)} times")
        text = text.replace(old, new)
    return text


def scale(plant: dict[str, Any], path: tuple[str, ...], factor: float) -> None:
    """Multiply the quantity at ``path``, which keeps its unit."""
    *parents, name = path
    for parent in parents:
        plant = plant[parent]
    plant[name] = with_unit(plant[name], number_of(plant[name]) * factor)


def with_unit(quantity: str | float, value: float) -> str:
    """Return ``value`` in the unit that ``quantity`` is written in."""
    return f"{value!r} {str(quantity).partition(' ')[2]}".strip()


def number_of(quantity: str | float) -> float:
    """Return the number of a quantity as it is written, in any unit."""
    return float(str(quantity).partition(" ")[0])
