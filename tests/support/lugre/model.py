"""A model file of the simulated rig on PVC, as far as `rigd design` reads it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.rig import sensors as rows
from rigd_analyses.lugre.rig.system import FITTED_NAMES

#: Friction of the simulated rig (configs/plants/lugre.yaml).
PVC: Final = np.array([0.0044, 0.12, np.log(0.15 / 0.12), 49.933, 0.372, 2.8084])
RIPPLE: Final = 0.3
#: What the recordings show of the sensors and the drive.
SENSOR_ROWS: Final = {
    rows.PERIOD: 1e-3, rows.CURRENT_NOISE: 6e-3, rows.ANGLE_COUNT: 3.03e-4,
    rows.POSITION_COUNT: 3.07e-5, rows.ACCELERATION_NOISE: 0.03, rows.TOP_SPEED: 1.9,
    rows.VOLTAGE_AT_REST: 7.5, rows.VOLTAGE_SLOPE: 0.1867,
}  # fmt: skip


def fitted_constants() -> dict[str, float]:
    """Return the constants of the simulated rig as a fit corrects them."""
    drive = 0.0295 * 0.81 * 20.25
    given = {
        "drive_gain": drive, "no_load": 0.0381, "wheel_viscous": 6.3e-4, "wheel_inertia": 8.5e-4,
        "guide_friction": 0.304, "rolling_resistance": 0.022, "wheel_radius": 0.05,
        "ripple_sin": RIPPLE, "shake_2_sin": 0.15,
        "mass": 3.9593,
    }  # fmt: skip
    return {name: given.get(name, 0.0) for name in FITTED_NAMES}


def saved_model(folder: Path, **change: Any) -> Path:
    """Write the file to ``folder``, with ``change`` in it, and return its path."""
    fitted = {rows.FITTED + name: value for name, value in fitted_constants().items()}
    settings = {**SENSOR_ROWS, **fitted}
    names = [item.name for item in PARAMETERS]
    point = {
        "names": change.get("names", names),
        "units": [item.unit for item in PARAMETERS],
        "values": list(PVC),
        "covariance": (1e-6 * np.eye(6)).tolist(),
    }
    path = folder / "model.json"
    model = {
        "model": change.get("model", "lugre"), "group": "pvc", "conditions": {"floor": "pvc"},
        "fit": {"point": point},
        "preprocessing": {"settings": change.get("settings", settings)},
    }  # fmt: skip
    path.write_text(json.dumps(model))
    return path
