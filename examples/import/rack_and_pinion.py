"""Makes old data of a friction test of a rack and pinion: one stroke, two loggers, two rates.

    python rack_and_pinion.py [FOLDER]

writes `stroke_3_force.csv` (2 kHz, volts of a load cell, decimal commas) and `stroke_3_speed.csv`
(100 Hz, in mm/s, times in ms). The friction is a static law with the parameters that
`maps/rack_and_pinion.yaml` calls published. It shares no code with rigd.
"""

import math
import random
import sys
from pathlib import Path

COULOMB_N, BREAKAWAY_N, STRIBECK_M_S, VISCOUS_N_S_M = 5.0, 8.0, 0.004, 400.0
ZERO_V, N_PER_V, NOISE_N = 0.12, 50.0, 15.0


def speed(t_s: float) -> float:
    """Return the speed in m/s: up in 0.3 s, from 0.4 to 0.6 m/s in 1.5 s, down in 0.3 s."""
    if t_s < 0.5 or t_s > 2.6:
        return 0.0
    if t_s < 0.8:
        return 0.4 * (t_s - 0.5) / 0.3
    if t_s < 2.3:
        return 0.4 + 0.2 * (t_s - 0.8) / 1.5
    return 0.6 * (2.6 - t_s) / 0.3


def friction(v_m_s: float) -> float:
    """Return the friction in N at a speed in m/s; none at rest."""
    if v_m_s <= 0.0:
        return 0.0
    stribeck = math.exp(-((v_m_s / STRIBECK_M_S) ** 2))
    return COULOMB_N + (BREAKAWAY_N - COULOMB_N) * stribeck + VISCOUS_N_S_M * v_m_s


def main(folder: Path) -> None:
    """Write both files."""
    noise = random.Random(7)
    lines = ["Load cell 200 kg, stroke 3", "Zeit [s];Kraft [V]"]
    for i in range(6000):
        force_n = friction(speed(i / 2000)) + noise.gauss(0.0, NOISE_N)
        line = f"{i / 2000:.4f};{ZERO_V + force_n / N_PER_V:.5f}"
        lines.append(line.replace(".", ","))
    (folder / "stroke_3_force.csv").write_text("\n".join(lines) + "\n")
    lines = ["t_ms,v_mm_s"]
    lines += [f"{10 * i},{1000 * speed(i / 100):.2f}" for i in range(300)]
    (folder / "stroke_3_speed.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]))
