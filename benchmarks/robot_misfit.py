"""Is what the robot's identification gives right, refused or named in a world unlike the model?

    python benchmarks/robot_misfit.py                      every world, about 15 minutes of CPU
    python benchmarks/robot_misfit.py --only camera        worlds with this word in the name

A row for each world (``tests/support/articulated/worlds.py``): the verdict, by how many half widths
the worst interval misses the truth, CPU time, the first sentence.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.articulated.random_robots import NAMES
from support.articulated.worlds import WORLDS, RobotWorld

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.result import FitOutcome
from rigd.model.errors import RigdError

CHANCE = 1.5  #: half widths, as in the other benches of misfit


def row(world: RobotWorld, number: int, folder: Path) -> tuple[str, float, str]:
    """Return the verdict on one world, the worst miss in half widths, the first sentence."""
    robot, driven = world.robot(number, folder), folder / "run.mcap"
    ended = robot.record(driven)
    if ended.exit_code:
        return "not driven", 0.0, f"the run was {ended.ending}: {ended.reason}"
    try:
        evaluation = evaluate([world.written(driven, folder / "world.mcap")], Options())
    except RigdError as error:
        return "refused", 0.0, str(error)
    assert isinstance(evaluation, ParameterEvaluation)
    result = evaluation.sections[0].result
    assert result.gate is not None
    if result.gate.outcome is FitOutcome.MISFIT:
        return "refused", 0.0, result.gate.sentence
    worst = 0.0
    for name in NAMES:
        entry = result.parameter(name)
        if entry.low is not None and entry.high is not None:
            middle, half = 0.5 * (entry.low + entry.high), 0.5 * (entry.high - entry.low)
            worst = max(worst, abs(robot.truth[name] - middle) / half)
    hit = "right" if worst <= 1.0 else "near" if worst <= CHANCE else "wrong"
    named = result.gate.outcome is FitOutcome.CORRECTED
    return f"named, {hit}" if named else hit, worst, result.gate.sentence


def main() -> None:
    """Identify the robot of every world and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", help="worlds whose name holds this", metavar="WORD")
    parser.add_argument("--robot", type=int, default=1, help="number of the robot (default 1)")
    args = parser.parse_args()
    verdicts: Counter[str] = Counter()
    for name, world in WORLDS.items():
        if args.only not in name:
            continue
        begun = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            verdict, worst, sentence = row(world, args.robot, Path(folder))
        verdicts[verdict] += 1
        took = time.process_time() - begun
        print(f"{name:<42} {verdict:<13} {worst:4.1f} {took:5.1f} s  {sentence[:150]}", flush=True)
    for verdict, count in verdicts.most_common():
        noted(f"worlds {verdict}", count, f"of {verdicts.total()}")
    wrong = sum(count for verdict, count in verdicts.items() if verdict.endswith("wrong"))
    at_most("worlds with a wrong number", wrong, 0, "")


if __name__ == "__main__":
    main()
