"""scripts/need names and installs what a machine lacks."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

NEED = Path(__file__).parents[2] / "scripts" / "need"
#: What stands in for the machine: programs by name.
MACHINE = {
    "ldconfig": 'echo "\tlibc.so.6 (libc6,x86-64) => /lib/libc.so.6"',
    "id": "echo 0",
    "node": "",
    "apt-get": 'echo "apt-get $*" >>installed',
    "grep": 'exec /usr/bin/grep "$@"',
}


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """A machine with node and libc."""
    for name, text in MACHINE.items():
        program = tmp_path / name
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)
    return tmp_path


def need(machine: Path, *names: str) -> str:
    """Return the packages that are installed for ``names``."""
    subprocess.run(["/bin/sh", NEED, *names], cwd=machine, env={"PATH": str(machine)}, check=True)
    done = machine / "installed"
    lines = done.read_text().splitlines() if done.exists() else ["apt-get install"]
    return lines[-1].rpartition("--no-install-recommends ")[2]


def test_missing_library_brings_its_package(machine: Path) -> None:
    assert need(machine, "node", "libc.so.6", "libatomic.so.1") == "libatomic1"


def test_missing_commands_bring_their_packages(machine: Path) -> None:
    assert need(machine, "node", "cc", "chromium") == "gcc libc6-dev chromium"


def test_complete_machine_gets_nothing(machine: Path) -> None:
    need(machine, "node", "libc.so.6")
    assert not (machine / "installed").exists()
