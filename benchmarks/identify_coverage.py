"""How often do the 95 % intervals hold the truth? Experiments on random rigs, per floor.

    python benchmarks/identify_coverage.py --rigs 30 --keep coverage.jsonl
                        continues the file: stop it and start it as you like
    python benchmarks/identify_coverage.py --first 31 --rigs 60 --keep coverage.jsonl
                        rigs 31 to 60; the table has all of the file up to 60

Every experiment is a rig of its own (``tests/support/lugre/random_rigs.py``): friction, masses,
drive, vibration and noise are drawn within what is realistic, and so are the positions of wheel and
carriage at the start and between which counts of their encoders. It is recorded, and evaluated as
``rigd identify`` does. For ``--method output-error`` each constant of the recording is drawn around
the truth with its stated uncertainty; slip-force takes the constants as exact, and gets them so.
`spread` is the standard deviation of the errors over the half width of the intervals: about 0.5 if
the intervals are right. Far below it they are too wide, or nothing varied: coverage then has no
meaning.

``--peers`` evaluates the same recordings, also those of rigs that the file has, by method A without
the gate of output error, by plain least squares with s^2 (J'J)^-1 (:mod:`identify_plain`) and, if
it is installed, by mujoco.sysid (:mod:`identify_mujoco`).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from figures import at_least, at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from identify_mujoco import fitted, is_installed
from identify_plain import plain_least_squares
from support.lugre.coverage import RIGHT_RATIO, TOO_LITTLE, Coverage, Found, coverage
from support.lugre.random_rigs import FLOORS, RandomRig, measured, random_rig

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.recordings.source import open_sweep
from rigd.analysis.result import IdentificationResult
from rigd.model.errors import RigdError
from rigd_analyses.lugre.reading import OUTPUT_ERROR, arrays, rig_constants
from rigd_analyses.lugre.slip_force.identify import identify_lugre

TARGET = 88.0  #: %, of the nominal 95
WINDOW: Final = (92.0, 98.0)  #: %, that the coverage of each quoted interval is to be in
PAGES: Final = 10  #: the report, a quarter of an experiment's time, is drawn for one rig in ten
SLIP_M_S = np.array([0.005, 0.010, 0.020, 0.035, 0.050])
PARAMETERS: Final = ("V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2")
#: What the paper's tests leave open on these floors; if it is quoted it must be right.
OFTEN_OPEN: Final = ("V_s", "mu_c", "mu_s")
METHOD_A, PLAIN, SYSID = PEERS = (
    "method A without a gate", "plain least squares", "mujoco.sysid",
)  # fmt: skip
Row = dict[str, Any]


def study(
    rigs: int, keep: Path | None, floors: tuple[str, ...] = FLOORS, method: str = "",
    peers: bool = False, first: int = 1,
) -> None:  # fmt: skip
    """Print the coverage of every interval over rigs ``first`` to ``rigs`` of each floor."""
    rows: dict[tuple[str, int], Row] = {}
    asked = set(PEERS) if peers else set()
    if peers and not is_installed():
        print(f"{SYSID} is not installed (pip install 'mujoco[sysid]'): it is not compared")
        asked.remove(SYSID)

    def add(row: Row) -> None:
        known = rows.setdefault((row["floor"], row["number"]), {})
        found = {**known.get("peers", {}), **row.get("peers", {})}
        known.update(row, **({"peers": found} if found else {}))

    for line in keep.read_text().splitlines() if keep is not None and keep.exists() else []:
        add(json.loads(line))
    for number in range(first, rigs + 1):
        for floor in floors:
            new = []
            if "found" not in rows.get((floor, number), {}):
                new.append(_experiment(floor, number, method))
            if missing := asked - set(rows.get((floor, number), {}).get("peers", {})):
                new.append(_peers(floor, number, method, missing))
            for row in new:
                add(row)
                if keep is not None:
                    with keep.open("a") as stream:
                        stream.write(json.dumps(row) + "\n")
    for floor in floors:
        done = [row for (of, number), row in rows.items() if of == floor and number <= rigs]
        _report(floor, [row for row in done if "found" in row])
        for peer in PEERS:
            found = [row["peers"] for row in done if peer in row.get("peers", {})]
            _report_peer(floor, peer, [row[peer] for row in found])


def _peers(floor: str, number: int, method: str, peers: Collection[str]) -> Row:
    """Return what ``peers`` make of the same recording; a text, if one of them refuses it."""
    with tempfile.TemporaryDirectory() as folder:
        rig = random_rig(number, floor, Path(folder))
        path = Path(folder) / "run.mcap"
        ended = rig.record(path, seed=number)
        if ended.exit_code:
            found = dict.fromkeys(peers, f"the run was {ended.ending}: {ended.reason}")
            return {"floor": floor, "number": number, "peers": found}
        if method == OUTPUT_ERROR:
            path = measured(path, number, floor)
        sweep = open_sweep(path)
        used = [(sweep, trial) for trial in sweep.trials]
        trials, constants = arrays(used)
        known = rig_constants(used, constants)
        ways: dict[str, Callable[[], dict[str, Found]]] = {
            METHOD_A: lambda: _outcome(rig, identify_lugre(trials, constants)),
            PLAIN: lambda: plain_least_squares(trials, known, rig.truth, SLIP_M_S),
            SYSID: lambda: plain_least_squares(trials, known, rig.truth, SLIP_M_S, fitted),
        }
        return {
            "floor": floor,
            "number": number,
            "peers": {peer: _or_refused(way) for peer, way in ways.items() if peer in peers},
        }


def _or_refused(way: Callable[[], dict[str, Found]]) -> dict[str, Found] | str:
    try:
        return way()
    except RigdError as error:
        return str(error)


def _experiment(floor: str, number: int, method: str) -> Row:
    """Return relative estimates and intervals by quantity, or what went wrong."""
    row: Row = {"floor": floor, "number": number, "found": {}, "refused": "", "crashed": ""}
    with tempfile.TemporaryDirectory() as folder:
        rig = random_rig(number, floor, Path(folder))
        path = Path(folder) / "run.mcap"
        ended = rig.record(path, seed=number)
        if ended.exit_code:
            return {**row, "refused": f"the run was {ended.ending}: {ended.reason}"}
        try:
            if method == OUTPUT_ERROR:
                path = measured(path, number, floor)
            evaluation = evaluate([path], Options(method=method))
            assert isinstance(evaluation, ParameterEvaluation)
            if number % PAGES == 0:
                evaluation.report()
        except RigdError as error:
            return {**row, "refused": str(error)}
        except Exception as error:  # noqa: BLE001 - reported, and counted as what it is
            return {**row, "crashed": f"{type(error).__name__}: {error}"}
        result = evaluation.sections[0].result
        if not evaluation.fits:
            return {**row, "refused": "" if result.gate is None else result.gate.sentence}
        return {**row, "found": _outcome(rig, result)}


def _outcome(rig: RandomRig, result: IdentificationResult) -> dict[str, Found]:
    out: dict[str, Found] = {}
    for name in PARAMETERS:
        entry, value = result.parameter(name), rig.truth[name]
        known = entry.identifiable and entry.low is not None and entry.high is not None
        low, high = (entry.low, entry.high) if known else (None, None)
        ends = [None if end is None else end / value for end in (low, high)]
        out[name] = (entry.estimate / value, ends[0], ends[1])
    curve = result.curve
    for slip, value in zip(SLIP_M_S, rig.friction(SLIP_M_S), strict=True):
        inside = curve.x[0] <= slip <= curve.x[-1]
        at = [float(np.interp(slip, curve.x, line)) / value for line in
              (curve.y, curve.low, curve.high)]  # fmt: skip
        out[f"g({1e3 * slip:.0f} mm/s)"] = (at[0], at[1], at[2]) if inside else (at[0], None, None)
    return out


def _report(floor: str, rows: list[Row]) -> None:
    refused = [row for row in rows if row["refused"]]
    crashed = [row for row in rows if row["crashed"]]
    whole = [row for row in rows if row["found"]]
    print(f"{floor}, {len(rows)} rigs; in % of the truth, with 95 % of the binomial:")
    for row in (*refused, *crashed):
        print(f"  rig {row['number']}: {row['refused'] or row['crashed']}")
    at_most(f"{floor}: internal errors of {len(rows)} rigs", len(crashed), 0, "")
    if not whole:
        return
    print(
        f"  {'':<12}{'quoted':>7}{'covered':>9}{'binomial':>12}{'bias':>11}{'sd':>10}{'worst':>10}"
        f"{'half width':>12}{'spread':>8}"
    )
    found = {name: coverage([row["found"][name] for row in whole]) for name in whole[0]["found"]}
    for name, item in found.items():
        print(_line(name, item))
    for name in ("sigma_0", "sigma_2"):
        _judge(f"{floor}: {name}", found[name])
    curve = [item for name, item in found.items() if name.startswith("g(") and item.quoted]
    if curve:
        worst = min(curve, key=lambda item: item.share)
        # Slip that a rig did not visit is none that it missed.
        _judge(f"{floor}: g, worst of 5 to 50 mm/s", replace(worst, experiments=worst.quoted))
    for name, item in found.items():
        if item.quoted:
            _within(f"{floor}: {name}", item)
    quoted = [found[name] for name in OFTEN_OPEN]
    wrong = sum(item.quoted - item.covered for item in quoted)
    total = sum(item.quoted for item in quoted)
    noted(f"{floor}: V_s, mu_c, mu_s quoted as known but missed", wrong, f"of {total}")


def _report_peer(floor: str, peer: str, outcomes: list[dict[str, Found] | str]) -> None:
    """Print the coverage of one peer; it is no figure of ours, so nothing judges it."""
    whole = [item for item in outcomes if not isinstance(item, str)]
    if whole:
        print(f"{floor}, {peer}, {len(whole)} of {len(outcomes)} rigs not refused:")
        for name in whole[0]:
            print(_line(name, coverage([item[name] for item in whole])))


def _line(name: str, item: Coverage) -> str:
    low, high = item.limits
    little = item.quoted > 1 and not item.varies
    nothing = "  errors hardly vary: too wide, or too narrow a study" if little else ""
    return (
        f"  {name:<12}{item.quoted:>7}{item.share:>9.0f}{f'{low:.0f} to {high:.0f}':>12}"
        f"{item.bias:>+11.2f}{item.sd:>10.2f}{item.worst:>10.2f}{item.half_width:>12.2f}"
        f"{item.ratio:>8.2f}{nothing}"
    )


def _within(name: str, item: Coverage) -> None:
    """Report whether the coverage of quoted intervals may be in the window: by its binomial."""
    low, high = item.limits
    at_least(f"{name} coverage, at most", high, WINDOW[0], "%")
    at_most(f"{name} coverage, at least", low, WINDOW[1], "%")


def _judge(name: str, item: Coverage) -> None:
    """Report the coverage; an interval that is not quoted does not cover."""
    low, high = item.limits
    covered = 100.0 * item.covered / item.experiments
    at_least(f"{name} covered ({low:.0f} to {high:.0f} if quoted)", covered, TARGET, "%")
    at_least(f"{name} spread of errors over half width", item.ratio, TOO_LITTLE * RIGHT_RATIO, "")


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--rigs", type=int, default=30, help="number of the last rig of each floor (default 30)"
    )
    parser.add_argument("--first", type=int, default=1, help="number of the first (default 1)")
    parser.add_argument("--keep", type=Path, help="JSON lines, read and appended to")
    parser.add_argument("--floor", choices=FLOORS, help="one floor instead of all three")
    parser.add_argument("--method", choices=("slip-force", OUTPUT_ERROR), default="slip-force")
    parser.add_argument("--peers", action="store_true", help="evaluate with the peers too")
    options = parser.parse_args()
    floors = FLOORS if options.floor is None else (options.floor,)
    study(options.rigs, options.keep, floors, options.method, options.peers, options.first)
    return 0


if __name__ == "__main__":
    sys.exit(main())
