"""The rig of the first paper with the filter of slip, and how well the filter did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from support.lugre.random_rigs import number_of

from rigd.record import Recording
from rigd.sdk.shipped_files import shipped_folder

#: Names of friction in `plants/lugre.yaml`, by those of the filter, with their units.
NAMES: Final = {
    "V_s": ("stribeck_speed", "m/s"), "mu_c": ("mu_coulomb", ""), "mu_s": ("mu_static", ""),
    "sigma_0": ("sigma_0", "1/m"), "sigma_1": ("sigma_1", "s/m"), "sigma_2": ("sigma_2", "s/m"),
}  # fmt: skip
STONE: Final = {"V_s": 1.9643, "mu_c": 0.12, "mu_s": 0.1205, "sigma_0": 11.451,
                "sigma_1": 0.0809, "sigma_2": 2.4490}  # fmt: skip
MISFIT: Final = """\
derived:
  fit.nis: {is: "mean(slip_filter.nis, 0.2 s)"}
"""


def observer(friction: Mapping[str, float] = STONE, rolling: float = 0.009, more: str = "") -> str:
    """Return the `observers` of a rig file; ``more`` are further lines of `constants`."""
    values = ", ".join(f"{name}: {friction[name]!r} {NAMES[name][1]}".rstrip() for name in NAMES)
    return f"""\
observers:
  slip_filter:
    model: lugre
    wheel_angle: wheel_encoder.angle
    acceleration: accelerometer.acceleration
    motor_current: wheel_servo.current
    carriage_held: longitudinal_belt.engaged_setpoint
    friction: {{{values}}}
    current_noise: 6 mA
    acceleration_noise: 0.03 m/s^2
    angle_count: 0.303 mrad
    unknown_push: 10 mm/s^2
    constants:
      mass: ${{rig.moving_mass}}
      rolling_resistance: {{value: {rolling!r}, u: 10 %}}
{more}"""


def from_model(name: str, constants: str) -> str:
    """Return the `observers` of a rig file with the model file ``name``."""
    head = observer().partition("    friction:")[0]
    return f"{head}    model_file: {name}\n    constants:\n{constants}"


def friction_of(surface: Mapping[str, str | float]) -> dict[str, float]:
    """Return friction by the filter's names, of a floor in `plants/lugre.yaml`."""
    return {name: number_of(surface[other]) for name, (other, _) in NAMES.items()}


def with_filter(text: str, observers: str, more: str = "") -> str:
    """Return a rig file with ``observers``, and with ``more`` before its interlocks."""
    return text.replace("interlocks:\n", f"{observers}{more}interlocks:\n", 1)


def slip_rig(folder: Path, observers: str, more: str = "", floor: str = "stone") -> Path:
    """Write the shipped rig with ``observers`` to ``folder``."""
    shipped = shipped_folder("configs")
    (folder / "plants").mkdir(parents=True)
    plant = shipped / "plants" / "lugre.yaml"
    (folder / "plants" / "lugre.yaml").write_text(plant.read_text("utf-8"), "utf-8")
    text = (
        (shipped / "sim_lugre.yaml").read_text("utf-8").replace("floor: stone", f"floor: {floor}")
    )
    (folder / "rig.yaml").write_text(with_filter(text, observers, more), "utf-8")
    return folder / "rig.yaml"


@dataclass(frozen=True)
class Score:
    """How a filter did in the driven parts of one recording."""

    rms_mm_s: float
    worst_mm_s: float  #: root mean square of the worst part
    held: float  #: share of the samples whose 95 % band holds the truth
    nis: float  #: its mean
    odometry_mm_s: float  #: slip of a wheel that is taken to roll, in the worst part


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def score(path: Path, step: str = "drive", rows: NDArray[np.void] | None = None) -> Score:
    """Return the score of the steps called ``step``; ``rows`` of a filter replace the recorded."""
    recording = Recording.open(path)
    truth = recording.read("truth")
    found = recording.read("slip_filter") if rows is None else rows
    errors, inside, nis, parts, rolling = [], [], [], [], []
    for item in recording.steps:
        if item.name != step or item.end_ns is None:
            continue
        begin, end = np.searchsorted(found["t_ns"], [item.start_ns, item.end_ns])
        known, true = found[begin:end], truth[begin:end]
        slip, sd, true_slip = known["slip"], known["slip_sd"], true["slip_speed"]
        error = slip - true_slip
        errors.append(error)
        inside.append(np.abs(error) < 1.96 * sd)
        nis.append(known["nis"])
        parts.append(_rms(error))
        rolling.append(_rms(true_slip))
    whole = np.concatenate(errors)
    return Score(
        1e3 * _rms(whole), 1e3 * max(parts),
        float(np.mean(np.concatenate(inside))), float(np.nanmean(np.concatenate(nis))),
        1e3 * max(rolling),
    )  # fmt: skip
