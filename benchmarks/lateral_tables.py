"""Tables III and IV of the paper on the simulated rig: 32 cells, lateral force ignored, included.

    python benchmarks/lateral_tables.py --seed 7             about 3 minutes of CPU

Stone is identified from the paper's sweep of currents, the lateral sweep with and without that
model. The numbers of the paper stand beside ours. Then the sweep is tried with a lever on the other
side, from which the same follows as from a turned lateral speed, and with the model of another
floor.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

from figures import at_least, at_most, noted
from identify_data import record

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.recordings.corrections import Corrections
from rigd.cli.views.evaluation import print_evaluation
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd_analyses.lugre.lateral.evaluation import LateralEvaluation, lateral
from rigd_analyses.lugre.lateral.result import LateralResult

#: Of the simulated rig (configs/plants/lugre.yaml).
TRUTH = {"mu_R_dry": 0.035, "mu_R_vis": 0.03}
LEVER = "12 mm"
#: Acceptance of docs/physics/lugre.md, section 7, item 7.
RATIO, CELLS = 10.0, 32


def sweep(seed: int, folder: Path) -> Path:
    """Record the lateral sweep; return the file."""
    rig, source = load_rig("lugre-1"), load_procedure("lateral_sweep")
    procedure = compile_procedure(source, rig)
    path = folder / f"lateral-{seed}.mcap"
    execute(RunRequest(procedure, source.file.text, rig, seed, output=path))
    return path


def model(floor: str, seed: int, folder: Path, *, anywhere: bool = False) -> Path:
    """Identify ``floor`` from constant currents; ``anywhere`` hides which floor it is of."""
    found = evaluate([record(floor, seed, folder)]).to_json()
    path = folder / f"{floor}.json"
    path.write_text(json.dumps({**found, "conditions": {}} if anywhere else found))
    return path


def identified(
    path: Path, model: Path | None = None, corrections: Corrections | None = None
) -> tuple[LateralEvaluation, LateralResult]:
    """Return the evaluation of the sweep, and its only result."""
    found = evaluate([path], Options(model=model), corrections=corrections)
    if not isinstance(found, LateralEvaluation):
        raise TypeError(f"{path} was not identified as a lateral sweep")
    (result,) = lateral(found.sections)
    return found, result


def tables(what: str, result: LateralResult) -> None:
    """Report the figures of one identification."""
    groups = {item.name: item for item in result.together}
    at_least(f"{what}: cells", groups["all"].trials, CELLS, "")
    for name, item in groups.items():
        at_least(f"{what}, {name}: ignored over included", item.ratio, RATIO)
        if item.paper is not None:
            noted(f"paper, {name}: ignored over included", item.paper.ratio, "x")
    held = 0
    for name, value in TRUTH.items():
        entry = result.parameter(name)
        held += (
            entry.low is not None and entry.high is not None and (entry.low <= value <= entry.high)
        )
    at_least(f"{what}: intervals of mu_R that hold the truth, of 2", held, 2, "")


def main() -> None:
    """Record, identify, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=7)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = sweep(args.seed, folder)
        stone = model("stone", args.seed + 1, folder)
        tables("friction fitted along", identified(recording)[1])
        found, result = identified(recording, stone)
        print_evaluation(found)
        tables("friction of the model", result)
        turned = Corrections({"guide_lever": f"-{LEVER}"})
        found, result = identified(recording, stone, turned)
        print(result.gate.sentence if result.gate is not None else "")
        named = not found.fits and "sign would have to be turned" in str(result.gate)
        at_least("lever on the other side named, of 1", named, 1, "")
        found, result = identified(recording, model("pvc", args.seed + 2, folder, anywhere=True))
        print(result.gate.sentence if result.gate is not None else "")
        at_most("model of another floor that gives numbers, of 1", found.fits, 0, "")


if __name__ == "__main__":
    main()
