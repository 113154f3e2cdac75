"""Identifies recordings with spoilt content and reports what is neither a result nor a refusal.

Each recording is a sound file whose rows, events, constants or plan are spoilt in one to three
ways. The identification must return a result that prints as JSON and as a report, or refuse with
one of rigd's errors. A failure prints the seed: `--seed N --count 1 --keep FILE` makes it again.

    python benchmarks/identify_fuzz.py --count 1000
"""

from __future__ import annotations

import argparse
import collections
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from figures import at_most, noted
from support.approach_angle.recording import calibration_of, small_campaign, write_campaign
from support.recordings.altered import Content, ending, spoilt

from rigd.analysis.analysis import Options
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder


def recorded(folder: Path) -> dict[str, Content]:
    """Return short recordings of both shipped rigs."""
    rig = load_rig("lugre-1")
    text = (shipped_folder("procedures") / "constant_current.yaml").read_text("utf-8")
    sweep = "{from: 0.15 A, to: 1.5 A, step: 0.15 A}"
    if sweep not in text:
        raise SystemExit(f"constant_current.yaml has no {sweep!r} any more")
    file = folder / "procedure.yaml"
    file.write_text(text.replace(sweep, "[0.45 A, 0.9 A, 1.35 A]"), "utf-8")
    source = load_procedure(file)
    procedure = compile_procedure(source, rig, {"floor": "pvc"})
    lugre = folder / "lugre.mcap"
    execute(RunRequest(procedure, source.file.text, rig, 1, output=lugre))
    trials = small_campaign()
    angle = write_campaign(folder / "angle.mcap", trials, calibration=calibration_of(trials[0].run))
    return {"lugre": Content.of(lugre), "angle": Content.of(angle)}


def main() -> int:
    """Spoil, identify, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first recording")
    parser.add_argument("--only", choices=("slip-force", "output-error", "angle"))
    parser.add_argument("--keep", type=Path, help="write the last spoilt recording here")
    args = parser.parse_args()
    kinds = ("slip-force", "output-error", "angle")
    found: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
    failures = warned = 0
    warnings.simplefilter("always")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        contents = recorded(folder)
        for seed in range(args.seed, args.seed + args.count):
            kind = args.only or kinds[seed % len(kinds)]
            source = contents["angle" if kind == "angle" else "lugre"]
            content, ways = spoilt(source, np.random.default_rng(seed))
            path = args.keep or folder / "spoilt.mcap"
            path.unlink(missing_ok=True)
            content.write(path)
            options = Options() if kind == "angle" else Options(method=kind)
            begun = time.process_time()
            with warnings.catch_warnings(record=True) as heard:
                warnings.simplefilter("always")
                try:
                    ended = ending(path, options)
                except Exception:  # noqa: BLE001 - what the bench looks for
                    ended = "traceback"
                    failures += 1
                    print(f"seed {seed}, {kind}: {ways}\n{traceback.format_exc()}", flush=True)
            took_s = time.process_time() - begun
            if heard:
                warned += 1
                where = f"{heard[0].filename}:{heard[0].lineno}"
                print(f"seed {seed}, {kind}: {ways}: {heard[0].message} ({where})", flush=True)
            if took_s > 60:
                print(f"seed {seed}, {kind}: {ways}: took {took_s:.0f} s", flush=True)
            found[kind][ended] += 1
            if args.count <= 20:
                print(f"seed {seed}, {kind}: {ways}: {ended}, {took_s:.1f} s", flush=True)
    for kind, endings in found.items():
        for ended, count in endings.most_common():
            noted(f"{kind}: {ended}", count, "recordings")
    at_most("spoilt recordings that end with a traceback", failures, 0, "")
    at_most("spoilt recordings with a warning of a library", warned, 0, "")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
