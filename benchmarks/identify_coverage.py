"""How often do the 95 % intervals hold the truth? Repeated simulated experiments per floor.

Every repetition is a whole experiment: a recorded run with a seed of its own, evaluated as
``rigd identify`` does. With ``keep`` the rows are appended to a file of JSON lines, one per
experiment, so that a long study can be done in slices.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from figures import at_least, noted
from identify_data import FLOORS, record, true_friction, truth

from rigd.evaluate.evaluation import evaluate
from rigd.evaluate.parameters import ParameterEvaluation
from rigd.identify.result import IdentificationResult

TARGET = 88.0  #: %, of the nominal 95
SLIP_M_S = np.array([0.005, 0.010, 0.020, 0.035, 0.050])
Row = dict[str, Any]


def study(seeds: int, keep: Path | None) -> None:
    """Print the coverage of every interval over ``seeds`` experiments per floor."""
    rows = [] if keep is None or not keep.exists() else _read(keep)
    for floor in FLOORS:
        done = [row for row in rows if row["floor"] == floor]
        for row in _experiments(floor, seeds - len(done)):
            done.append(row)
            if keep is not None:
                with keep.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")
        _report(floor, done[:seeds])


def _experiments(floor: str, count: int) -> Iterator[Row]:
    for _ in range(count):
        seed = int.from_bytes(os.urandom(3), "little") + 1
        with tempfile.TemporaryDirectory() as folder:
            found = evaluate([record(floor, seed, Path(folder))])
        assert isinstance(found, ParameterEvaluation)
        yield {"floor": floor, "seed": seed, "found": _outcome(floor, found.sections[0].result)}


def _outcome(floor: str, result: IdentificationResult) -> dict[str, list[float | None]]:
    """Return relative error, low and high (of the truth; None if not quoted) by quantity."""
    known = truth(floor)
    values = {
        "V_s": known.stribeck_speed,
        "mu_c": known.mu_coulomb,
        "mu_s": known.mu_static,
        "sigma_0": known.sigma_0,
        "sigma_2": known.sigma_2,
    }
    out: dict[str, list[float | None]] = {}
    for name, value in values.items():
        entry = result.parameter(name)
        ends = [None if end is None else end / value for end in (entry.low, entry.high)]
        out[name] = [entry.estimate / value, *ends]
    curve = result.curve
    for slip, value in zip(SLIP_M_S, true_friction(floor, SLIP_M_S), strict=True):
        inside = curve.x[0] <= slip <= curve.x[-1]
        lines = (curve.y, curve.low, curve.high)
        at_slip = [float(np.interp(slip, curve.x, line)) / value for line in lines]
        out[f"g({1e3 * slip:.0f} mm/s)"] = [*at_slip] if inside else [at_slip[0], None, None]
    return out


def _report(floor: str, rows: list[Row]) -> None:
    print(f"{floor}, {len(rows)} experiments; in % of the truth:")
    print(
        f"  {'':<12}{'quoted':>8}{'covered':>9}{'bias':>8}{'sd':>7}{'worst':>7}{'half width':>12}"
    )
    covered: dict[str, float] = {}
    for name in rows[0]["found"]:
        found = [row["found"][name] for row in rows]
        quoted = [row for row in found if row[1] is not None]
        hits = [low <= 1.0 <= high for _, low, high in quoted]
        error = 100.0 * (np.array([row[0] for row in (quoted or found)]) - 1.0)
        width = 50.0 * np.mean([high - low for _, low, high in quoted]) if quoted else np.nan
        # An interval that is not quoted does not cover; for V_s, mu_c, mu_s it may be right.
        covered[name] = 100.0 * sum(hits) / len(rows)
        share = 100.0 * np.mean(hits) if quoted else np.nan
        print(
            f"  {name:<12}{len(quoted):>8}{share:>9.0f}{np.mean(error):>+8.2f}{np.std(error):>7.2f}"
            f"{np.max(np.abs(error)):>7.2f}{width:>12.2f}"
        )
    at_least(f"{floor}: sigma_0 covered", covered["sigma_0"], TARGET, "%")
    at_least(f"{floor}: sigma_2 covered", covered["sigma_2"], TARGET, "%")
    worst = min(share for name, share in covered.items() if name.startswith("g("))
    at_least(f"{floor}: g covered, worst of 5 to 50 mm/s", worst, TARGET, "%")
    quoted = [
        row["found"][name]
        for row in rows
        for name in ("V_s", "mu_c", "mu_s")
        if row["found"][name][1] is not None
    ]
    wrong = sum(not low <= 1.0 <= high for _, low, high in quoted)
    noted(f"{floor}: V_s, mu_c, mu_s quoted as known but missed", wrong, f"of {len(quoted)}")


def _read(path: Path) -> list[Row]:
    return [json.loads(line) for line in path.read_text().splitlines()]
