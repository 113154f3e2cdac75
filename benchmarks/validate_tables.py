"""Table II of the paper on the simulated rig: 72 cells, wrong floors, a drive that is off.

    python benchmarks/validate_tables.py                     about 3 minutes of CPU
    python benchmarks/validate_tables.py --method output-error --seed 7
    python benchmarks/validate_tables.py --floor pvc         24 cells, no wrong floors

Each floor is identified from the paper's sweep of currents and validated on three masses with eight
currents, all recorded by rigd on the simulated rig, with noise, counts and shaking. The numbers of
the paper stand beside ours. Then each model is tried on the other floors, and on recordings whose
drive is off: a torque constant that is stated wrong, a current monitor with a zero.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from figures import at_least, at_most
from identify_data import FLOORS, record

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.recordings.corrections import Corrections
from rigd.analysis.validation.evaluation import validate
from rigd.analysis.validation.result import GroupValidation, ModelOutcome
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder

TORQUE_CONSTANT = 29.5  #: of the simulated rig, in mN m/A
SHARES = (-0.03, -0.01, 0.01, 0.03)
ZEROS_MA = (-10, -5, 5, 10)
#: Acceptance of docs/physics/lugre.md, section 7, item 6, in m/s.
SPEED, SLIP, WRONG_SLIP = 0.005, 0.002, 0.004
NAMED_WITHIN = 0.25  #: of the bias itself


def masses(floor: str, seed: int, folder: Path, rig_file: Path | str = "lugre-1") -> Path:
    """Record the validation tests on ``floor``; return the file."""
    rig, source = load_rig(rig_file), load_procedure("validation_masses")
    procedure = compile_procedure(source, rig, {"floor": floor})
    path = folder / f"masses-{floor}-{seed}-{rig.name}.mcap"
    execute(RunRequest(procedure, source.file.text, rig, seed, output=path))
    return path


def rig_with_zero(folder: Path, zero_ma: int) -> Path:
    """Write a rig whose current monitor shows ``zero_ma`` too much; return its file."""
    home = folder / f"zero{zero_ma}"
    shutil.copytree(shipped_folder("configs") / "plants", home / "plants", dirs_exist_ok=True)
    plant = home / "plants" / "lugre.yaml"
    before = plant.read_text()
    after = before.replace("    zero: 0 mA\n", f"    zero: {zero_ma} mA\n")
    if after == before:
        raise ValueError(f"{plant} has no zero of the current monitor to change")
    plant.write_text(after)
    rig = home / "rig.yaml"
    text = (shipped_folder("configs") / "sim_lugre.yaml").read_text()
    rig.write_text(text.replace("rig: lugre-1\n", f"rig: lugre-zero{zero_ma}\n"))
    return rig


def only(path: Path, model: Path, corrections: Corrections | None = None) -> GroupValidation:
    """Return how one recording agrees with the only model of a file."""
    return validate(model, [path], corrections=corrections).result.groups[0]


def rms(groups: Sequence[GroupValidation], output: str) -> np.ndarray:
    """Return the errors of all trials as stated, in m/s."""
    return np.array([t.deviation(output).stated for group in groups for t in group.trials])


def cells(groups: Sequence[GroupValidation]) -> None:
    """Print every cell: ours and the paper's speed, and the slip, which the paper leaves out."""
    print(f"\n{'mm/s':>24}" + "".join(f"{group.label:^28}" for group in groups))
    print(" " * 24 + f"{'speed  paper   slip  limit':>28}" * len(groups))
    for row in zip(*(group.trials for group in groups), strict=True):
        conditions = row[0].conditions
        text = f"{conditions['mass']:>14}{conditions['current']:>10}"
        for trial in row:
            speed, slip = trial.deviation("speed"), trial.deviation("slip")
            values = (speed.rms, speed.published or np.nan, slip.rms, slip.limit or np.nan)
            text += "  " + "".join(f"{1e3 * value:6.2f} " for value in values)[:-1]
        print(text)


def swaps(recordings: dict[str, Path], models: dict[str, Path]) -> None:
    """Try every model on the other floors."""
    found = [
        (model, floor, only(recordings[floor], models[model]))
        for model in models
        for floor in recordings
        if model != floor
    ]
    for model, floor, group in found:
        slip = 1e3 * rms([group], "slip")
        print(
            f"model of {model:10} on {floor:10}: {group.outcome.value}, slip "
            f"{np.min(slip):.1f} .. {np.median(slip):.1f} .. {np.max(slip):.1f} mm/s, "
            f"speed at most {1e3 * np.max(rms([group], 'speed')):.1f} mm/s"
        )
    rejected = sum(group.outcome is ModelOutcome.REJECTED for *_, group in found)
    at_least("wrong floors rejected, of 6", rejected, len(found), "")
    wrong = np.concatenate([rms([group], "slip") for *_, group in found])
    at_least("wrong floor: least slip RMS", float(np.min(wrong)), WRONG_SLIP, "m/s")


def drive(floor: str, recording: Path, model: Path, folder: Path, seed: int) -> None:
    """Try a model on recordings whose drive is off."""
    cases: list[tuple[str, str, float, GroupValidation]] = []
    for share in SHARES:
        stated = {"torque_constant": f"{TORQUE_CONSTANT * (1.0 + share):.6g} mN m/A"}
        group = only(recording, model, Corrections(stated))
        cases.append((f"K_t {100 * share:+.0f} %", "torque_constant", -share, group))
    for zero in ZEROS_MA:
        path = masses(floor, seed, folder, rig_with_zero(folder, zero))
        cases.append((f"zero {zero:+d} mA", "current_zero", 1e-3 * zero, only(path, model)))
    named = 0
    for what, name, size, group in cases:
        own = [bias for bias in group.biases if bias.name == name]
        found = np.nan
        if own:
            bias = own[0]
            found = bias.value if name == "current_zero" else bias.value / bias.stated - 1.0
        right = len(group.biases) == 1 and abs(found - size) < NAMED_WITHIN * abs(size)
        named += right and group.outcome is ModelOutcome.CORRECTED
        print(
            f"{floor:10} {what:11}: {group.outcome.value}; as stated speed "
            f"{1e3 * np.median(rms([group], 'speed')):.1f} mm/s; {group.sentence[:110]}"
        )
    at_least(f"{floor}: drive biases named, of {len(cases)}", named, len(cases), "")


def main() -> None:
    """Record, identify, validate, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--floor", action="append", choices=FLOORS)
    parser.add_argument("--method", choices=["slip-force", "output-error"], default="")
    args = parser.parse_args()
    floors = args.floor or FLOORS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings = {floor: masses(floor, args.seed + 3, folder) for floor in floors}
        models = {}
        for floor in floors:
            identified = record(floor, args.seed, folder)
            result = evaluate([identified], Options(method=args.method))
            models[floor] = folder / f"{floor}.json"
            models[floor].write_text(json.dumps(result.to_json()))
        right = [only(recordings[floor], models[floor]) for floor in floors]
        cells(right)
        for group in right:
            print(f"{group.label}: {group.outcome.value}. {group.sentence}")
        at_most("right floor: largest speed RMS", float(np.max(rms(right, "speed"))), SPEED, "m/s")
        at_most("right floor: largest slip RMS", float(np.max(rms(right, "slip"))), SLIP, "m/s")
        if len(floors) > 1:
            swaps(recordings, models)
        for floor in floors:
            drive(floor, recordings[floor], models[floor], folder, args.seed + 3)


if __name__ == "__main__":
    main()
