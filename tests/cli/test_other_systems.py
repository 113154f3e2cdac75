"""What needs no device works as on Windows; all else says in one sentence that it needs Linux."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from support.commands.elsewhere import HEAVY, LIBRARIES, Ended, run_elsewhere

from rigd.sdk.shipped_files import shipped_folder

#: What Windows refuses, each tried as rigd could try it.
REFUSED = """
import os, signal, sys
from pathlib import Path
__name__ = "rigd.trial"
Path("taken").write_bytes(b"1")
taken = open("taken", "rb")
def text(): os.open("taken", os.O_RDONLY)
def folder(): os.open(".", os.O_RDONLY)
def named(): open("a:b", "wb")
def shared(): open("/dev/shm/x", "rb")
def replaced(): os.replace("told0", "taken")
def caught(): signal.signal(10, print)
def encoding(): Path("taken").read_text()
for trial in (text, folder, named, shared, replaced, caught, encoding):
    try: trial()
    except (OSError, ValueError, EncodingWarning) as error: print(trial.__name__, "refused")
try: import fcntl
except ImportError: print("fcntl refused")
"""
CLIENT = """
from rigd.remote import AsyncClient, Client
try: Client("nothing", endpoint="tcp/127.0.0.1:1")
except Exception as error: print(type(error).__name__)
"""
#: What `make test` does elsewhere, in this order, and a word that it shows.
QUICK = {
    "refused": (["-c", REFUSED], "fcntl refused"),
    "run": (["run", "quick", "--rig", "lugre-1", "--output", "quick.mcap"], "complete"),
    "note": (["note", "quick.mcap", "--author", "me", "new coating"], "new coating"),
    "client": (["-c", CLIENT], "LinkError"),
}
#: What needs Linux.
LINUX = {
    "real time": ["run", "quick", "--rig", "lugre-1", "--pace", "1"],
    "serve": ["serve", "--rig", "lugre-1"],
    "panel": ["panel"],
    "sim": ["sim", "wire-1"],
    "read": ["read", "--rig", "lugre-1"],
    "tare": ["tare", "--rig", "lugre-1", "scale"],
    "jog": ["jog", "--rig", "lugre-1", "wheel_servo.current=0.1 A"],
    "doctor": ["doctor"],
    "recover": ["recover", "quick.mcap"],
}
#: The whole path of a campaign; `make test-long` plays it.
WHOLE = {
    "import": (
        ["import", "stroke_3_*.csv", "--map", "rack_and_pinion", "--out", "."],
        "stroke_3.mcap: 1 trial",
    ),
    "check": (["check", "few.yaml", "--rig", "wire-1"], "right"),
    "rehearse": (["run", "few.yaml", "--rig", "wire-1", "--dry-run"], "predicted peaks"),
    "device": (["run", "few.yaml", "--rig", "wire-1"], "needs Linux"),
    "run": (
        ["run", "few.yaml", "--rig", "lugre-1", "--set", "floor=pvc", "--output", "pvc.mcap"],
        "3 of 3 trials",
    ),
    "resume": (["run", "--resume", "pvc.mcap"], "complete"),
    "note": (["note", "pvc.mcap", "--author", "me", "new coating"], "new coating"),
    "info": (["info", "*.mcap"], "stroke_3_speed.csv"),
    "csv": (["export", "pvc.mcap", "--to", "csv", "--stream", "wheel_servo"], "wheel_servo.csv"),
    "again": (
        [
            "run",
            "few.yaml",
            "--rig",
            "lugre-1",
            "--set",
            "floor=pvc",
            "--seed",
            "2",
            "--output",
            "again.mcap",
        ],
        "3 of 3 trials",
    ),
    "verify": (["verify", "pvc.mcap", "stroke_3.mcap"], "pvc.mcap: whole"),
    "mat": (["export", "pvc.mcap", "--to", "mat", "--stream", "carriage"], "carriage.mat"),
    "hdf5": (["export", "pvc.mcap", "--to", "hdf5"], "pvc.h5"),
    "identify": (["identify", "pvc.mcap", "--starts", "1"], "sigma_0"),
    "old": (["identify", "stroke_3.mcap"], "k_v"),
    "report": (["report", "stroke_3.mcap"], "stroke_3-run.html"),
    "compare": (["compare", "pvc.mcap", "again.mcap", "--method", "slip-force"], "mu_c"),
    "runs": (["runs", ".", "--where", 'set.floor == "pvc"'], "pvc.mcap"),
    "list": (["remote", "list"], "no rig at"),
    "drivers": (["drivers"], "modbus-servo"),
    "analyses": (["analyses"], "static-friction"),
    "can": (["can", "eds", "configs/eds/rigd_servo.eds"], "vendor"),
    "schema": (["schema", "map"], "sources"),
    "new": (["new", "plant", "cart"], "wrote cart"),
}
CURRENTS = "current: {from: 0.15 A, to: 1.5 A, step: 0.15 A}"


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    """What each of QUICK and LINUX printed, by its name."""
    made = tmp_path_factory.mktemp("elsewhere")
    left = "import os; print(sorted(name for name in os.listdir() if not name.startswith('told')))"
    commands = {name: command for name, (command, _) in QUICK.items()}
    commands |= {**LINUX, "left": ["-c", left]}
    return dict(zip(commands, run_elsewhere(list(commands.values()), made), strict=True))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    """What each of WHOLE printed, by its name."""
    made = tmp_path_factory.mktemp("whole")
    text = (shipped_folder("procedures") / "constant_current.yaml").read_text("utf-8")
    assert text.count(CURRENTS) == 1
    (made / "few.yaml").write_text(text.replace(CURRENTS, "current: [0.45 A, 0.9 A, 1.5 A]"))
    script = Path(__file__).parents[2] / "examples/import/rack_and_pinion.py"
    subprocess.run([sys.executable, script, "."], cwd=made, check=True, capture_output=True)
    commands = {name: command for name, (command, _) in WHOLE.items()}
    return dict(
        zip(
            commands,
            run_elsewhere(list(commands.values()), made, [*LIBRARIES, *HEAVY]),
            strict=True,
        )
    )


@pytest.mark.parametrize("name", QUICK)
def test_command_without_linux_works(quick: dict[str, Ended], name: str) -> None:
    assert quick[name].code == 0, quick[name].told
    assert QUICK[name][1] in quick[name].told


def test_hidden_system_refuses_what_windows_refuses(quick: dict[str, Ended]) -> None:
    assert quick["refused"].told.count("refused") == 8, quick["refused"].told


@pytest.mark.parametrize("name", LINUX)
def test_command_that_needs_linux_says_so(quick: dict[str, Ended], name: str) -> None:
    assert quick[name].code == 2, quick[name].told
    assert quick[name].told.count("\n") == 1
    assert "needs Linux" in quick[name].told


def test_refused_run_leaves_no_folder(quick: dict[str, Ended]) -> None:
    assert "['quick.mcap', 'taken']" in quick["left"].told, quick["left"].told


@pytest.mark.timeout(1500)  # of the fixture, on a crowded machine
@pytest.mark.parametrize("name", WHOLE)
def test_campaign_without_linux_works(whole: dict[str, Ended], name: str) -> None:
    assert whole[name].code == 2 * (name == "device"), whole[name].told
    assert WHOLE[name][1] in whole[name].told
