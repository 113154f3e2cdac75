"""Reading, checking, exporting and identifying need nothing that Linux alone has."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.command import rigd

#: Modules and functions that Python on Windows does not have; macOS has most of them.
HIDDEN = """
import importlib.abc
import os
import sys

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

from rigd.cli.main import main

sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("elsewhere")
    ran = rigd(
        "run", "constant_current", "--rig", "lugre-1", "--set", "floor=pvc",
        "--output", "pvc.mcap", cwd=made,
    )  # fmt: skip
    assert ran.code == 0, ran.err
    assert rigd("info", "pvc.mcap", "--attachments", "files", cwd=made).code == 0
    shutil.copy(made / "files" / "procedure.yaml", made / "procedure.yaml")
    return made


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["info", "pvc.mcap"], "10 complete"),
        (["runs", "."], "constant_current"),
        (["verify", "pvc.mcap"], "pvc.mcap: sound"),
        (["export", "pvc.mcap", "--to", "csv", "--stream", "carriage"], "carriage.csv"),
        (["export", "pvc.mcap", "--to", "mat", "--stream", "carriage"], "carriage.mat"),
        (["identify", "pvc.mcap", "--starts", "1"], "sigma_0"),
        (["check", "procedure.yaml", "--rig", "lugre-1"], "procedure.yaml"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_what_reads_runs_without_the_modules_of_linux(
    folder: Path, arguments: list[str], said: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    assert said in done.stdout + done.stderr


def test_repairing_says_that_it_needs_linux(folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN, "recover", "pvc.mcap"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "Linux" in done.stderr
    assert "bug in rigd" not in done.stderr
