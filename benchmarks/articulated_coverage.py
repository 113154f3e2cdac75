"""How often do the 95 % intervals of the robot's contacts hold the truth? On random robots.

    python benchmarks/articulated_coverage.py --robots 200 --keep robots.jsonl
                        continues the file: stop it and start it as you like

Every experiment is a robot of its own (``tests/support/articulated/random_robots.py``): contacts,
mass, camera, sensors and manoeuvres are drawn, and so are the stated constants within their
uncertainties. It is recorded, and evaluated as ``rigd identify`` does.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from figures import at_least, at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.articulated.random_robots import NAMES, random_robot
from support.lugre.coverage import RIGHT_RATIO, TOO_LITTLE, coverage

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.result import FitOutcome
from rigd.model.errors import RigdError

LEAST, MOST = 92.0, 98.0  #: %, of the nominal 95
Row = dict[str, Any]
Spread: Final = RIGHT_RATIO * TOO_LITTLE


def experiment(number: int) -> Row:
    """Return estimates and intervals of one robot over its truth, or what went wrong."""
    row: Row = {"number": number, "found": {}, "refused": "", "named": "", "crashed": ""}
    with tempfile.TemporaryDirectory() as folder:
        robot = random_robot(number, Path(folder))
        path = Path(folder) / "run.mcap"
        ended = robot.record(path)
        if ended.exit_code:
            return {**row, "refused": f"the run was {ended.ending}: {ended.reason}"}
        try:
            evaluation = evaluate([path], Options())
        except RigdError as error:
            return {**row, "refused": str(error)}
        except Exception as error:  # noqa: BLE001 - reported, and counted as what it is
            return {**row, "crashed": f"{type(error).__name__}: {error}"}
    assert isinstance(evaluation, ParameterEvaluation)
    result = evaluation.sections[0].result
    assert result.gate is not None
    if result.gate.outcome is FitOutcome.MISFIT:
        return {**row, "refused": result.gate.sentence}
    if result.gate.outcome is FitOutcome.CORRECTED:
        row["named"] = result.gate.sentence
    for name in NAMES:
        entry, truth = result.parameter(name), robot.truth[name]
        ends = [None if end is None else end / truth for end in (entry.low, entry.high)]
        row["found"][name] = (entry.estimate / truth, *ends)
    return row


def report(rows: list[Row]) -> None:
    """Print the coverage of each parameter."""
    for row in rows:
        if text := row["refused"] or row["crashed"] or row["named"]:
            print(f"  robot {row['number']}: {text}")
    print(f"{len(rows)} robots; in % of the truth, with 95 % of the binomial:")
    at_most(f"internal errors of {len(rows)} robots", sum(bool(r["crashed"]) for r in rows), 0, "")
    noted("robots refused", sum(bool(row["refused"]) for row in rows), f"of {len(rows)}")
    noted("robots with a suspect", sum(bool(row["named"]) for row in rows), f"of {len(rows)}")
    whole = [row for row in rows if row["found"]]
    for name in NAMES if whole else ():
        item = coverage([row["found"][name] for row in whole])
        low, high = item.limits
        print(
            f"  {name:<8} {item.covered} of {item.quoted} held ({low:.0f} to {high:.0f} %), bias "
            f"{item.bias:+.2f} %, sd {item.sd:.2f} %, worst {item.worst:.2f} %, half width "
            f"{item.half_width:.2f} %"
        )
        at_least(f"{name} held", item.share, LEAST, "%")
        at_most(f"{name} held", item.share, MOST, "%")
        at_least(f"{name}: spread of errors over half width", item.ratio, Spread, "")


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robots", type=int, default=200, help="random robots (default 200)")
    parser.add_argument("--keep", type=Path, help="JSON lines, read and appended to")
    options = parser.parse_args()
    keep: Path | None = options.keep
    lines = keep.read_text().splitlines() if keep is not None and keep.exists() else []
    rows = {row["number"]: row for row in map(json.loads, lines)}
    for number in range(1, options.robots + 1):
        if number in rows:
            continue
        rows[number] = experiment(number)
        if keep is not None:
            with keep.open("a") as stream:
                stream.write(json.dumps(rows[number]) + "\n")
    report([rows[number] for number in sorted(rows) if number <= options.robots])
    return 0


if __name__ == "__main__":
    sys.exit(main())
