"""What commands print, write and return, from the run to its figures, as a user plays them.

Each file of the folder that they leave stands behind them: recordings by digests of their parts,
pages without their drawings, of which a digest is kept.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from contract.golden import Check
from contract.transcript import Transcript

PVC = "run constant_current --rig lugre-1 --set floor=pvc --seed 1 --output pvc.mcap"
pytestmark = pytest.mark.timeout(1800)

#: What is played in a folder, in this order. What stands before ``>`` is kept in that file.
SESSIONS: dict[str, tuple[str, ...]] = {
    "friction of a wheel": (
        PVC,
        "run validation_masses --rig lugre-1 --set floor=pvc --seed 2 --output masses.mcap",
        "info pvc.mcap",
        "info pvc.mcap --json",
        "verify pvc.mcap masses.mcap",
        "identify pvc.mcap --no-report",
        "identify pvc.mcap --json --report pvc.html > model.json",
        "identify pvc.mcap --method slip-force --no-report",
        "identify pvc.mcap --compare --no-report",
        "validate model.json masses.mcap --no-report",
        "validate model.json masses.mcap --json --report validation.html > validation.json",
        "design --model model.json --minutes 2 --rig lugre-1 -o designed.yaml",
        "report pvc.mcap --output run.html",
    ),
    "campaigns compared": (
        "run constant_current --rig lugre-1 --set floor=pvc --seed 3 --output before.mcap",
        "run constant_current --rig lugre-1 --set floor=pvc --seed 4 --output after.mcap",
        "run constant_current --rig lugre-1 --set floor=stone --seed 3 --output stone.mcap",
        "compare before.mcap after.mcap",
        "compare before.mcap after.mcap --json --report page.html > compared.json",
        "compare before.mcap stone.mcap",
        "identify *.mcap --json --no-report > models.json",
    ),
    "lateral sweep": (
        "run constant_current --rig lugre-1 --set floor=stone --seed 1 --output stone.mcap",
        "identify stone.mcap --json --no-report > model.json",
        'run lateral_sweep --rig lugre-1 --set lateral_speed="0.35 m/s" --output lateral.mcap',
        "identify lateral.mcap --model model.json --no-report",
        "identify lateral.mcap --model model.json --json --report lateral.html > lateral.json",
    ),
    "breakaway": (
        "run breakaway --rig lugre-1 --seed 1 --output breakaway.mcap --junit run.xml",
        "measure breakaway.mcap",
        "measure breakaway.mcap --json",
        "measure breakaway.mcap --junit measured.xml",
        "report breakaway.mcap --output run.html",
    ),
    "robot": (
        "run robot_manoeuvres --rig articulated-1 --seed 1 --output robot.mcap",
        "run straight_speeds --rig articulated-1 --seed 2 --output straight.mcap",
        "identify robot.mcap --no-report",
        "identify robot.mcap --json --report robot.html > model.json",
        "validate model.json straight.mcap --no-report",
    ),
    "approach angles": (
        "run calibrate_torque --rig angle-1 --seed 1 --output torque.mcap",
        "calibrate --from torque.mcap --operator A",
        "run calibrate_scale --rig angle-1 --seed 1 --output scale.mcap",
        "run approach_angles --rig angle-1 --set set=clean_15 --set load=4kg --output angles.mcap",
        "identify angles.mcap --no-report",
        "identify angles.mcap --json --report angles.html > angles.json",
        "report angles.mcap --output run.html",
    ),
    "tribometer": (
        "run sliding_speeds --rig tribometer-1 --seed 1 --output sliding.mcap",
        "measure sliding.mcap",
        "measure sliding.mcap --json",
        "identify sliding.mcap",
    ),
    "files": (
        "run quick --rig lugre-1 --seed 1 --output quick.mcap",
        "run quick --rig lugre-1 --seed 2 --output quick.mcap",
        "run quick --rig lugre-1 --dry-run --seed 1",
        "run quick --rig lugre-1 --dry-run --seed 1 --json",
        "check quick --rig lugre-1",
        "note quick.mcap worn --author A",
        "runs . --json",
        'runs . --where "rig == lugre-1 and trials > 0"',
        'runs . --where "rig = lugre-1"',
        "recover quick.mcap",
        "verify quick.mcap --json",
        'export quick.mcap --to csv --rate "100 Hz"',
        "export quick.mcap --to parquet",
        "export quick.mcap --to csv --stream nothing",
        "layout lugre-1 --to foxglove",
        "layout lugre-1 --to plotjuggler",
    ),
}

#: Exit codes of commands that are refused, or whose answer is no; all others end with 0.
CODES = {
    "compare before.mcap stone.mcap": 7,  # no trials of one kind
    "calibrate --from torque.mcap --operator A": 3,  # no terminal to ask at
    "identify sliding.mcap": 7,  # its procedure has no plan
    "run quick --rig lugre-1 --seed 2 --output quick.mcap": 7,  # the file is there
    'runs . --where "rig = lugre-1"': 2,
    "export quick.mcap --to csv --stream nothing": 7,
}


@pytest.mark.parametrize("session", SESSIONS)
def test_session_is_as_before(session: str, tmp_path: Path, unchanged: Check) -> None:
    transcript = Transcript(tmp_path)
    for command in SESSIONS[session]:
        words = re.fullmatch(r"(?P<played>.*?)(?: > (?P<kept>[\w.]+))?", command)
        assert words is not None
        code = transcript.play(words["played"], keep=words["kept"])
        assert code == CODES.get(command, 0), transcript.text
    transcript.files()
    unchanged(session, transcript.text)
