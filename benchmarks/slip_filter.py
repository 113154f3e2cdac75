"""How near does the filter of slip come, does its band hold, and what does it cost a cycle?

    python benchmarks/slip_filter.py --rigs 8

Cases: the paper's ten currents on each floor, against the plant's truth. First as in lugre.md
section 9, with friction and constants as they are. Then on rigs drawn at random
(``tests/support/lugre/random_rigs.py``), as a lab would do it: every constant is as far off as its
stated uncertainty, one campaign is identified by output error, and its model gives the filter
friction, corrected constants and noise for another campaign. A rig whose model does not fit is
counted, and gives no filter. At last with the friction of another floor, which the innovations must
show.

A recording gives the same rows as the run (``rigd filter``), so that the campaigns are filtered
afterwards. The cost is that of a cycle in virtual time with the filter, beside the same rig
without it.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from derived import ROUNDS, play
from figures import at_least, at_most, in_turn, noted
from ruamel.yaml import YAML

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.lugre.random_rigs import FLOORS, RandomRig, measured, number_of, random_rig
from support.lugre.slip import Score, friction_of, from_model, observer, score, with_filter
from support.recordings.altered import Content

from rigd.analysis.recordings.observers import filtered
from rigd.config.loader import load_rig, parse_rig
from rigd.record import Recording
from rigd_analyses.lugre.trials.known_constants import CONSTANTS


def offline(recording: Path, rig: RandomRig, observers: str) -> Score:
    """Return how a filter does with a campaign of ``rig``."""
    text = with_filter(rig.rig.read_text("utf-8"), observers)
    found = filtered(Recording.open(recording), parse_rig(text, rig.rig), "slip_filter")
    return score(recording, rows=found.rows)


def exact(floor: str, other: str) -> tuple[Score, Score]:
    """Return the scores on the shipped rig, with its own friction and with that of ``other``."""
    with tempfile.TemporaryDirectory() as folder:
        rig = random_rig(0, floor, Path(folder))
        rig.record(Path(folder) / "run.mcap", 1)
        floors = YAML().load(Path(folder) / "plant.yaml")["floors"]
        own, wrong = (
            offline(
                Path(folder) / "run.mcap", rig,
                observer(friction_of(floors[name]), number_of(floors[name]["rolling"])),
            )
            for name in (floor, other)
        )  # fmt: skip
    return own, wrong


def of_lab(number: int, floor: str) -> Score | None:
    """Return the score with an identified model on a random rig; None if the model does not fit."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig = random_rig(number, floor, folder)
        rig.record(folder / "first.mcap", 2 * number)
        rig.record(folder / "second.mcap", 2 * number + 1)
        known = measured(folder / "first.mcap", number, floor)
        command = [sys.executable, "-m", "rigd", "identify", str(known), "--json"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        model = json.loads(done.stdout)
        if model["gate"]["outcome"] != "fits":
            return None
        (folder / "model.json").write_text(done.stdout, "utf-8")
        return offline(folder / "second.mcap", rig, from_model("model.json", constants(known)))


def constants(recording: Path) -> str:
    """Return the constants of the recording's plan, as lines of an observer."""
    content = Content.of(recording)
    lines = []
    for name, u in content.plan("uncertainties").items():
        value, unit = content.plan("constants")[name], CONSTANTS[name][0]
        unit = "" if unit == "per turn" else unit
        size = u["size"] * (abs(value) if u["is_share"] else 1.0)
        lines.append(f"      {name}: {{value: {value!r} {unit}, u: {size!r} {unit}}}\n")
    return "".join(lines)


def cost() -> None:
    """Report what the filter adds to a cycle."""
    path = load_rig("lugre-1").source.path
    text = path.read_text("utf-8")
    rigs = [parse_rig(item, path) for item in (text, with_filter(text, observer()))]
    for rig in rigs:
        play(rig)
    (bare, _, _), (_, added, ratio) = in_turn([partial(play, rig) for rig in rigs], ROUNDS)
    noted("a cycle in virtual time without the filter", bare, "us")
    at_most("the filter of slip, added to a cycle", added, 40, "us")
    noted("the filter of slip, virtual time longer by", 100 * (ratio - 1), "%")


def main() -> None:
    """Play the cases and report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=4, help="random rigs for each floor")
    count = parser.parse_args().rigs
    cost()
    for floor in FLOORS:
        other = FLOORS[(FLOORS.index(floor) + 1) % len(FLOORS)]
        own, wrong = exact(floor, other)
        print(f"{floor}, exact: {own}\n{floor}, friction of {other}: {wrong}", flush=True)
        at_most(f"{floor}, exact: slip, rms of the worst drive", own.worst_mm_s, 1.5, "mm/s")
        noted(f"{floor}, exact: the same of a wheel that rolls", own.odometry_mm_s, "mm/s")
        noted(f"{floor}, exact: truth in the 95 % band", 100 * own.held, "%")
        at_least(f"{floor}: NIS with the friction of {other} / its own", wrong.nis / own.nis, 2)
        tried = [of_lab(number, floor) for number in range(1, count + 1)]
        scores = [item for item in tried if item is not None]
        for item in tried:
            print(f"{floor}, random rig: {item or 'its model does not fit'}", flush=True)
        noted(f"{floor}, random rigs: models that fit, of {count}", len(scores), "rigs")
        if scores:
            worst = max(item.worst_mm_s for item in scores)
            held = 100 * statistics.mean(item.held for item in scores)
            at_most(f"{floor}, random rigs: slip, rms of the worst drive", worst, 1.5, "mm/s")
            at_least(f"{floor}, random rigs: truth in the 95 % band", held, 90, "%")
            at_most(f"{floor}, random rigs: truth in the 95 % band, at most", held, 99, "%")


if __name__ == "__main__":
    main()
