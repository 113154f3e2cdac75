"""What a process must not load: it costs every command, and each process of a run, CPU time."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.daemon.served_rig import RIG, serve
from support.panel.played_rig import RUN

ROOT = Path(__file__).parents[2]
#: What reads files, plans, draws, analyses, serves or waits for events: nothing a run at work does.
NOT_AT_WORK = {
    "asyncio", "canopen", "jinja2", "matplotlib", "numba", "pyarrow", "pymodbus", "rich",
    "rigd.analysis", "rigd.config.document", "rigd.config.loader", "rigd.config.source",
    "rigd.procedure.compile", "rigd.procedure.source", "ruamel.yaml", "scipy", "starlette",
    "uvicorn", "zenoh",
}  # fmt: skip
#: What takes longer to import than a stop takes to reach the rig.
NOT_FOR_A_STOP = NOT_AT_WORK - {"zenoh"} | {"cryptography", "numpy", "pydantic", "rigd.engine"}


def loaded(code: str, **environment: str) -> set[str]:
    """Return the modules of a fresh process after ``code``."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport json, sys\nprint(json.dumps([*sys.modules]))"],
        env={**os.environ, "PYTHONPATH": ""} | environment,
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
        "rigd.engine.process.cycle_process",
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
    assert "rigd.cli.rig.run" in modules
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


@pytest.mark.parametrize("verb", ["stop", "abort", "estop"])
def test_stop_loads_nothing_but_the_link(verb: str, tmp_path: Path) -> None:
    """Neither by options nor by a list of rigs that was read before."""
    listed = tmp_path / "config" / "rigd" / "remotes.yaml"
    listed.parent.mkdir(parents=True)
    homes = {"XDG_CONFIG_HOME": str(tmp_path / "config"), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    with serve() as remote:
        listed.write_text(f"remotes: {{{RIG}: {{endpoint: {remote.endpoint}, identity: ann}}}}")
        find = "import time; at = time.time_ns; time.time_ns = lambda: at() + 10**10\n"
        assert "pydantic" in loaded(
            find + "from rigd.remote.client.rigs.target import find_target; find_target()", **homes
        )
        for options in (["--endpoint", remote.endpoint, "--as", "ann"], []):
            remote.rig.state, remote.rig.run = "running", RUN
            modules = loaded(
                f"from rigd.cli.main import main\nmain({['remote', verb, *options]!r})", **homes
            )
            assert "rigd.remote.client.stopping" in modules
            assert not modules & NOT_FOR_A_STOP
        assert remote.rig.done == [("ann", verb)] * 2
