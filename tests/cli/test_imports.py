"""What a process must not load: it costs every command, and each process of a run, CPU time."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: What reads files, plans, draws, analyses, serves or waits for events: nothing a run at work does.
NOT_AT_WORK = {
    "asyncio", "canopen", "jinja2", "matplotlib", "numba", "pyarrow", "pymodbus", "rich",
    "rigd.analysis", "rigd.config.document", "rigd.config.loader", "rigd.config.source",
    "rigd.procedure.compile", "rigd.procedure.source", "ruamel.yaml", "scipy", "starlette",
    "uvicorn", "zenoh",
}  # fmt: skip


def loaded(code: str) -> set[str]:
    """Return the modules of a fresh process after ``code``."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport json, sys\nprint(json.dumps([*sys.modules]))"],
        env={**os.environ, "PYTHONPATH": ""},
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def check(file: str) -> str:
    return f"from rigd.cli.main import main\nmain(['check', {file!r}])"


@pytest.mark.parametrize(
    "module",
    [
        "rigd.engine.cycle_process",
        "rigd.engine.recorder.service",
        "rigd.engine.slow.block_process",
    ],
)
def test_process_of_a_run_loads_its_work_only(module: str) -> None:
    modules = loaded(f"import {module}")
    assert module in modules
    assert not modules & NOT_AT_WORK


def test_command_line_loads_no_libraries() -> None:
    modules = loaded("from rigd.cli.main import build_parser\nbuild_parser()")
    assert "rigd.cli.run" in modules
    assert not modules & (NOT_AT_WORK | {"numpy", "pydantic", "rigd.record"})


def test_importing_rigd_loads_nothing_else() -> None:
    before = loaded("from __future__ import annotations\nimport importlib, typing")
    assert loaded("import rigd") - before == {"rigd"}


def test_opening_a_recording_loads_no_analysis() -> None:
    modules = loaded("import rigd\nrigd.open")
    assert "rigd.record" in modules
    assert not modules & (NOT_AT_WORK | {"pandas", "rigd.engine", "rigd.procedure"})


def test_checking_a_rig_loads_no_procedures() -> None:
    modules = loaded(check("configs/sim_lugre.yaml"))
    assert "rigd.config.loader" in modules
    assert not modules & {"numba", "numpy", "rigd.engine", "rigd.procedure", "rigd.record", "scipy"}


def test_no_source_is_parsed_for_descriptions() -> None:
    code = "import inspect\ndef read(*_): raise SystemExit('source was read')\n"
    code += "inspect.getsource = inspect.findsource = inspect.getsourcelines = read\n"
    assert "rigd.config.source" in loaded(code + check("configs/sim_lugre.yaml"))
