"""Reading, checking, exporting and identifying need nothing that Linux alone has."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass

import pytest
from support.command import rigd

from rigd.sdk.shipped import shipped_folder

#: Modules and functions that Python on Windows does not have; macOS has most of them. Each command
#: is a process that begins when what rigd imports of others is there, and has rigd still to import.
HIDDEN = """
import importlib.abc
import json
import os
import sys

fork = os.fork

MODULES = {
    "fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty",
    "uvloop", "rigd_drivers",
}
FUNCTIONS = (
    "eventfd", "fchmod", "fdatasync", "fork", "getpgid", "getuid", "geteuid", "killpg",
    "posix_fallocate", "pread", "preadv", "pwrite", "pwritev", "sched_getaffinity",
    "sched_setaffinity", "sched_setscheduler", "sysconf", "uname",
)


class Hide(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


for name in MODULES & set(sys.modules):
    del sys.modules[name]
sys.meta_path.insert(0, Hide())
import numba, pyarrow, scipy.stats, matplotlib.pyplot  # of others, which know their systems
for name in FUNCTIONS:
    if hasattr(os, name):
        delattr(os, name)
for name in ("O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW"):
    delattr(os, name)

codes = []
for number, arguments in enumerate(json.loads(sys.argv[1])):
    process = fork()
    if not process:
        told = os.open(f"told{number}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(told, 1)
        os.dup2(told, 2)
        from rigd.cli.main import main

        sys.exit(main(arguments))
    codes.append(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]))
json.dump(codes, sys.stdout)
"""
#: What is done with a recording, and a word that it shows.
READING = {
    "info": (["info", "pvc.mcap"], "3 begun"),
    "runs": (["runs", "."], "constant_current"),
    "verify": (["verify", "pvc.mcap"], "pvc.mcap: sound"),
    "csv": (["export", "pvc.mcap", "--to", "csv", "--stream", "carriage"], "carriage.csv"),
    "mat": (["export", "pvc.mcap", "--to", "mat", "--stream", "carriage"], "carriage.mat"),
    "identify": (["identify", "pvc.mcap", "--starts", "1"], "sigma_0"),
    "check": (["check", "procedure.yaml", "--rig", "lugre-1"], "procedure.yaml"),
}
RECOVER = ["recover", "pvc.mcap"]
CURRENTS = "current: {from: 0.15 A, to: 1.5 A, step: 0.15 A}"


@dataclass(frozen=True)
class Ended:
    """A command that has ended, and what it printed."""

    code: int
    told: str


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    """Every command on a recording of three trials, by its name."""
    made = tmp_path_factory.mktemp("elsewhere")
    text = (shipped_folder("procedures") / "constant_current.yaml").read_text("utf-8")
    assert text.count(CURRENTS) == 1
    (made / "few.yaml").write_text(text.replace(CURRENTS, "current: [0.45 A, 0.9 A, 1.5 A]"))
    ran = rigd(
        "run", "few.yaml", "--rig", "lugre-1", "--set", "floor=pvc", "--output", "pvc.mcap",
        cwd=made,
    )  # fmt: skip
    assert ran.code == 0, ran.err
    assert rigd("info", "pvc.mcap", "--attachments", "files", cwd=made).code == 0
    shutil.copy(made / "files" / "procedure.yaml", made / "procedure.yaml")
    commands = {**{name: command for name, (command, _) in READING.items()}, "recover": RECOVER}
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN, json.dumps(list(commands.values()))],
        cwd=made,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    codes = json.loads(done.stdout)
    return {
        name: Ended(code, (made / f"told{number}").read_text("utf-8"))
        for number, (name, code) in enumerate(zip(commands, codes, strict=True))
    }


@pytest.mark.parametrize("name", READING)
def test_reading_needs_no_module_of_linux_alone(ended: dict[str, Ended], name: str) -> None:
    assert ended[name].code == 0, ended[name].told
    assert READING[name][1] in ended[name].told


def test_repair_without_linux_is_refused(ended: dict[str, Ended]) -> None:
    assert ended["recover"].code != 0
    assert "Linux" in ended["recover"].told
    assert "bug in rigd" not in ended["recover"].told
