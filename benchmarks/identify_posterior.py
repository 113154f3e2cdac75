"""Does the posterior agree with the profiles? Whole recordings of the simulated rig, each floor.

    python benchmarks/identify_posterior.py --floor pvc

``constant_current`` is played and identified by output error with ``--posterior``. For each
parameter that has a number are reported: the half width of the credible interval over that of the
table's, R-hat and effective draws; and the CPU time of all. A floor takes two to four minutes.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from figures import at_most, noted

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.control import Control
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd_analyses.lugre.reading import OUTPUT_ERROR

FLOORS: Final = ("stone", "pvc", "paperboard")
AGREE: Final = 10.0  #: %


def study(floor: str, seed: int) -> None:
    """Print how the posterior of one floor compares with the table."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{floor}.mcap"
        procedure, rig = load_procedure("constant_current"), load_rig("lugre-1")
        compiled = compile_procedure(procedure, rig, {"floor": floor})
        request = RunRequest(compiled, procedure.file.text, rig, seed, output=path)
        ended = perform(request, Control()).result
        assert ended.exit_code == 0, ended.reason
        begun = time.process_time()
        found = evaluate([path], Options(method=OUTPUT_ERROR, posterior=True))
        noted(f"{floor}: CPU of identification and posterior", time.process_time() - begun, "s")
    assert isinstance(found, ParameterEvaluation)
    result = found.sections[0].result
    posterior = result.posterior
    if posterior is None:
        print(f"{floor}: no posterior, the model does not fit")
        return
    noted(f"{floor}: simulations of all trials", posterior.evaluations, "")
    for warning in posterior.warnings:
        print(f"  {warning}")
    for item in posterior.parameters:
        print(
            f"  {item.name:<10}R-hat {item.r_hat:.4f}, effective draws {item.bulk:.0f}, "
            f"of the tails {item.tail:.0f}, modes {len(item.modes)}"
        )
        beside = result.parameter(item.name)
        ends = (item.low, item.high, beside.low, beside.high)
        if None not in ends:
            low, high, other_low, other_high = (float(end or 0.0) for end in ends)
            ratio = math.log(high / low) / math.log(other_high / other_low)
            at_most(
                f"{floor}: half width of {item.name}, off the table's by",
                100.0 * abs(ratio - 1.0), AGREE, "%",
            )  # fmt: skip


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--floor", choices=FLOORS, help="one floor instead of all three")
    parser.add_argument("--seed", type=int, default=1, help="seed of the run (default 1)")
    options = parser.parse_args()
    for floor in FLOORS if options.floor is None else (options.floor,):
        study(floor, options.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
