"""Does a designed procedure keep its promise? Floors and seeds, on the simulated rig.

    python benchmarks/design_promise.py --seeds 2 --keep design.jsonl
                        goes on where the file ends: stop it and start it as you like

For each floor and seed ``constant_current`` is played and identified by output error; of this model
a procedure of equal length is designed, played with other noise and identified too. Reported are
the half widths that it gives over those that it promised, and over those of ``constant_current``.
One cell takes two minutes of CPU.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from figures import at_least, at_most, noted

from rigd.analysis.analysis import Options
from rigd.analysis.design.command import design
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import Procedure, load_procedure, parse_procedure
from rigd_analyses.lugre.design.design import DEFAULT
from rigd_analyses.lugre.design.subject import obtained
from rigd_analyses.lugre.reading import OUTPUT_ERROR

FLOORS: Final = ("stone", "pvc", "paperboard")
MINUTES: Final = 1.25  #: as long as constant_current takes
WITHIN: Final = 0.2  #: relative difference of a promise that is kept
Row = dict[str, Any]


def study(seeds: int, floors: tuple[str, ...], keep: Path | None) -> None:
    """Print how promises are kept over ``seeds`` on each of the ``floors``."""
    known = keep.read_text().splitlines() if keep is not None and keep.exists() else []
    rows: list[Row] = [json.loads(line) for line in known]
    done = {(row["floor"], row["seed"]) for row in rows}
    for seed in range(1, seeds + 1):
        for floor in floors:
            if (floor, seed) in done:
                continue
            rows.append(cell(floor, seed))
            _show(rows[-1])
            if keep is not None:
                with keep.open("a") as stream:
                    stream.write(json.dumps(rows[-1]) + "\n")
    for floor in floors:
        _report(floor, [row for row in rows if row["floor"] == floor and row["seed"] <= seeds])


def cell(floor: str, seed: int) -> Row:
    """Return the half widths by target: promised, obtained, and those of constant_current."""
    base = load_procedure("constant_current")
    with tempfile.TemporaryDirectory() as folder:
        before = _identified(base, floor, seed, Path(folder) / "before.mcap")
        model = Path(folder) / "model.json"
        model.write_text(json.dumps(before.to_json()))
        designed = design(model, load_rig("lugre-1"), base, MINUTES, (), "designed")
        procedure = parse_procedure(designed.text, Path("designed.yaml"))
        after = _identified(procedure, floor, seed + 1000, Path(folder) / "after.mcap")
    promised = {item.target: item.half_width for item in designed.promises}
    return {
        "floor": floor,
        "seed": seed,
        "fits": before.fits and after.fits,
        "targets": {
            name: {
                "promised": promised[name],
                "obtained": obtained(after.sections[0].result, name),
                "constant_current": obtained(before.sections[0].result, name),
            }
            for name in DEFAULT
        },
    }


def _identified(procedure: Procedure, floor: str, seed: int, path: Path) -> ParameterEvaluation:
    rig = load_rig("lugre-1")
    compiled = compile_procedure(procedure, rig, {"floor": floor})
    request = RunRequest(compiled, procedure.file.text, rig, seed, output=path)
    ended = perform(request, Control()).result
    if ended.exit_code:
        raise RuntimeError(f"the run was {ended.ending}: {ended.reason}")
    evaluation = evaluate([path], Options(method=OUTPUT_ERROR))
    if not isinstance(evaluation, ParameterEvaluation):
        raise TypeError(f"{path} is evaluated to {type(evaluation).__name__}")
    return evaluation


def _show(row: Row) -> None:
    print(f"{row['floor']}, seed {row['seed']}, fits: {row['fits']}; half widths in %")
    print(f"  {'':<10}{'promised':>10}{'obtained':>10}{'constant':>10}")
    for name, item in row["targets"].items():
        cells = [item[key] for key in ("promised", "obtained", "constant_current")]
        shown = ["open" if value is None else f"{100.0 * value:.3g}" for value in cells]
        print(f"  {name:<10}" + "".join(f"{text:>10}" for text in shown), flush=True)


def _report(floor: str, rows: list[Row]) -> None:
    items = [item for row in rows for item in row["targets"].values()]
    both = [item for item in items if item["promised"] and item["obtained"]]
    otherwise = [item for item in items if (item["promised"] is None) != (item["obtained"] is None)]
    ratios = [item["obtained"] / item["promised"] for item in both]
    if not ratios:
        return
    at_least(f"{floor}: smallest obtained over promised half width", min(ratios), 1.0 - WITHIN)
    at_most(f"{floor}: largest obtained over promised half width", max(ratios), 1.0 + WITHIN)
    noted(f"{floor}: intervals promised closed or open, and found otherwise", len(otherwise),
          f"of {len(items)}")  # fmt: skip
    narrower = [item["obtained"] / item["constant_current"] for item in both
                if item["constant_current"]]  # fmt: skip
    at_most(f"{floor}: largest half width over that of constant_current", max(narrower), 1.0)


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3, help="seeds per floor (default 3)")
    parser.add_argument("--floor", choices=FLOORS, help="one floor instead of all three")
    parser.add_argument("--keep", type=Path, help="JSON lines, read and appended to")
    options = parser.parse_args()
    study(options.seeds, FLOORS if options.floor is None else (options.floor,), options.keep)
    return 0


if __name__ == "__main__":
    sys.exit(main())
