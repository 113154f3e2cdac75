"""scripts/bare on a machine that cannot make a bare one; `.ci/run` plays it on one that can."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

BARE = Path(__file__).parents[2] / "scripts" / "bare"
#: What the machine has in place of its own programs, and why it then cannot.
UNFIT = {
    "only root can make one": {"id": "echo 1000"},
    "unshare has no right to namespaces": {"id": "echo 0", "unshare": "exit 1"},
    "its apt has no source of Debian bookworm": {
        "id": "echo 0", "unshare": "", "debootstrap": "",
        "apt-get": "echo http://a Other jammy main",
    },
}  # fmt: skip


@pytest.mark.parametrize("why", UNFIT)
def test_unfit_machine_says_why_in_a_line(why: str, tmp_path: Path) -> None:
    for name, text in {"apt-get": "", **UNFIT[why]}.items():
        program = tmp_path / name
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "HOME": str(tmp_path)}
    done = subprocess.run(
        [BARE, "true"], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (75, "")
    assert done.stderr == f"rigd: no bare Debian on this machine: {why}\n"
