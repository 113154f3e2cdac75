"""`rigd/` without drivers, plants and analyses: each command works, or names what is missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rigd.cli.main import COMMANDS
from rigd.model.errors import Exit

ROOT = Path(__file__).parents[2]
#: What stands beside `rigd/` in this distribution; its entry points stay.
BESIDE = ("rigd_analyses", "rigd_drivers", "rigd_sim")
RIG = ROOT / "configs" / "sim_lugre.yaml"
WIRE_RIG = ROOT / "configs" / "wire_lugre.yaml"
WORKS = [
    "report run.mcap",
    "measure run.mcap --plan plan.yaml",
    "compare --help",
    "validate --help",
    "design --help",
    "runs .",
    "info run.mcap",
    "note run.mcap seen",
    "export run.mcap --to csv",
    "import table.csv --map map.yaml",
    "verify run.mcap",
    "recover run.mcap",
    "doctor",
    "remote --help",
    "panel --help",
    "drivers",
    "analyses",
    "can --help",
    "new driver acme-gauge",
    "schema rig",
    "completion bash",
]
#: Without a driver there is no rig: each command that needs one names the package of its drivers.
NAMES_WHAT_IS_MISSING = [
    (f"run breakaway --rig {RIG}", "rigd_sim"),
    (f"jog amplifier=0.1A --rig {RIG}", "rigd_sim"),
    (f"read --rig {RIG}", "rigd_sim"),
    (f"tare amplifier --rig {RIG}", "rigd_sim"),
    ("identify run.mcap --plan plan.yaml", "rigd_analyses"),
    (f"calibrate calibrate_torque --operator me --rig {RIG}", "rigd_sim"),
    (f"check breakaway --rig {RIG}", "rigd_sim"),
    (f"layout {RIG} --to foxglove", "rigd_sim"),
    (f"filter run.mcap --rig {RIG}", "rigd_sim"),
    (f"doctor --rig {RIG}", "rigd_sim"),
    (f"serve --rig {RIG}", "rigd_sim"),
    (f"sim {WIRE_RIG}", "rigd_drivers"),
    ("new rig bench", "rigd_sim"),
]
PLAN = """
identify:
  model: lugre
  signals: {motor_current: wheel_servo.current}
measure:
  current: {mean: wheel_servo.current, unit: A}
"""
MAP = """\
map: pull
rig: tensile-tester
started: "2016-03-04T10:00:00Z"
sources:
  cell:
    file: table.csv
    time: {column: t, unit: s}
    channels:
      force: {column: f, unit: N}
"""


#: Plays each line of its input as a command, in a process of its own after the imports.
PLAY = f"""
import os, sys
sys.modules.update(dict.fromkeys({BESIDE}))
from rigd.cli.main import main
import rigd.config.loader, rigd.engine.run.run, rigd.procedure.loader  # once, not in each
for number, line in enumerate(sys.stdin):
    if (child := os.fork()) == 0:
        screen = os.open(f"{{number}}.txt", os.O_CREAT | os.O_WRONLY)
        os.dup2(screen, 1), os.dup2(screen, 2)
        sys.exit(main(line.split()))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """Play all commands without the packages beside `rigd`; return exit codes and texts."""
    folder = tmp_path_factory.mktemp("alone")
    run = f"run quick --rig {RIG} --output run.mcap --quiet"
    subprocess.run([sys.executable, "-m", "rigd", *run.split()], cwd=folder, check=True)
    plan = (ROOT / "procedures" / "quick.yaml").read_text("utf-8")
    (folder / "plan.yaml").write_text(plan + PLAN)
    (folder / "map.yaml").write_text(MAP)
    (folder / "table.csv").write_text("t,f\n" + "".join(f"{i},{i}\n" for i in range(100)))
    commands = [*WORKS, *dict(NAMES_WHAT_IS_MISSING)]
    done = subprocess.run(
        [sys.executable, "-c", PLAY],
        cwd=folder,
        input="\n".join(commands),
        capture_output=True,
        text=True,
        timeout=240,
        check=True,
    )
    codes = map(int, done.stdout.split())
    texts = [(folder / f"{number}.txt").read_text("utf-8") for number in range(len(commands))]
    return dict(zip(commands, zip(codes, texts, strict=True), strict=True))


def test_every_command_is_tried() -> None:
    tried = {command.partition(" ")[0] for command in [*WORKS, *dict(NAMES_WHAT_IS_MISSING)]}
    assert tried == {module.__name__.rpartition(".")[2].rstrip("_") for module in COMMANDS}


@pytest.mark.parametrize("command", WORKS)
def test_command_of_rigd_alone_succeeds(ended: dict[str, tuple[int, str]], command: str) -> None:
    code, text = ended[command]
    assert code == Exit.OK, text


@pytest.mark.parametrize(("command", "package"), NAMES_WHAT_IS_MISSING)
def test_command_names_the_missing_package(
    ended: dict[str, tuple[int, str]], command: str, package: str
) -> None:
    code, text = ended[command]
    assert code == Exit.BAD_INPUT, text
    assert f"reinstall the package that provides {package}." in text
    assert "Traceback" not in text
