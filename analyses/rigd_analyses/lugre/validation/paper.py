"""Lists Table II of the paper: RMS of measured minus estimated speed in its validation tests.

The values are in m/s. Tables III and IV are of lateral motion: `rigd identify` of a lateral sweep
compares with them (:mod:`rigd_analyses.lugre.lateral.speeds.published_cells`).
"""

from __future__ import annotations

from typing import Final

LABEL: Final = "Table II of the paper"
FLOORS: Final = ("stone", "pvc", "paperboard")
MASSES_KG: Final = (3.9593, 2.9593, 1.9593)
CURRENTS_A: Final = (0.45, 0.60, 0.75, 0.90, 1.05, 1.20, 1.35, 1.50)
#: A mass or current this close to that of a cell is that of the cell.
SAME_KG: Final = 0.01
SAME_A: Final = 0.005

#: By mass and floor, one value for each current.
TABLE_II: Final = (
    (
        (0.024, 0.016, 0.007, 0.010, 0.012, 0.016, 0.020, 0.012),
        (0.037, 0.035, 0.014, 0.008, 0.019, 0.009, 0.017, 0.024),
        (0.035, 0.006, 0.010, 0.021, 0.017, 0.011, 0.021, 0.013),
    ),
    (
        (0.022, 0.015, 0.013, 0.008, 0.022, 0.016, 0.025, 0.029),
        (0.036, 0.013, 0.011, 0.010, 0.011, 0.010, 0.014, 0.015),
        (0.031, 0.012, 0.011, 0.008, 0.015, 0.014, 0.012, 0.025),
    ),
    (
        (0.035, 0.015, 0.029, 0.018, 0.028, 0.038, 0.037, 0.025),
        (0.019, 0.016, 0.016, 0.018, 0.026, 0.033, 0.031, 0.029),
        (0.022, 0.022, 0.019, 0.022, 0.025, 0.025, 0.032, 0.015),
    ),
)


def published_speed_rms(floor: str | None, mass_kg: float, current_a: float) -> float | None:
    """Return the paper's RMS of the speed in m/s for this cell; None if it has no such cell."""
    rows = [k for k, mass in enumerate(MASSES_KG) if abs(mass - mass_kg) <= SAME_KG]
    columns = [k for k, current in enumerate(CURRENTS_A) if abs(current - current_a) <= SAME_A]
    if floor not in FLOORS or not rows or not columns:
        return None
    return TABLE_II[rows[0]][FLOORS.index(floor)][columns[0]]
