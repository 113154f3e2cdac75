"""Calculations that would keep the daemon from its run: done by a process of their own.

``python -m rigd.daemon.serve.aside`` reads one job as JSON, does it at low priority and prints
the result, or what was wrong, as JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rigd.engine.deaths import how_ended
from rigd.model.errors import RigdError
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.results import DryRun, Reported

#: A calculation that takes longer is given up: a little less than a client waits for it.
PATIENCE_S: Final = 890.0
#: The run under way, clients and panels come first.
NICENESS: Final = 15


class Aside:
    """Does one calculation at a time; :meth:`close` gives up the one under way."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._closed = False

    def dry_run(
        self, rig: str, rig_path: Path, procedure: str, settings: Mapping[str, str]
    ) -> DryRun:
        """Play a procedure on the plant of a rig, both given as texts; nothing moves.

        Raises:
            Refusal: it cannot be played, or took too long.
        """
        job = {"rig": rig, "rig_path": str(rig_path), "procedure": procedure, "set": dict(settings)}
        return DryRun.model_validate_json(json.dumps(self._do("dry_run", job)))

    def identify(self, recording: Path) -> Reported:
        """Identify what a recording holds, and write the report beside it.

        Raises:
            Refusal: the data cannot answer, or it took too long.
        """
        result = self._do("identify", {"recording": str(recording)})
        return Reported.model_validate_json(json.dumps(result))

    def draw(self, recording: Path) -> Reported:
        """Draw what a recording holds, and write the page beside it.

        Raises:
            Refusal: nothing of it can be read, or it took too long.
        """
        result = self._do("draw", {"recording": str(recording)})
        return Reported.model_validate_json(json.dumps(result))

    def close(self) -> None:
        """Give up what is under way; nothing more is done."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()

    def _do(self, what: str, job: Mapping[str, object]) -> object:
        process = self._start()
        try:
            out, err = process.communicate(json.dumps({"do": what, **job}), timeout=PATIENCE_S)
        except subprocess.TimeoutExpired as error:
            process.kill()
            process.communicate()
            raise Refusal(Code.REFUSED, f"{what} took longer than {PATIENCE_S:g} s") from error
        finally:
            with self._lock:
                self._process = None
        if self._closed:
            raise Refusal(Code.CONFLICT, "the daemon is ending")
        if process.returncode < 0:  # by a person, or for want of memory
            ended = how_ended(process.returncode)
            raise Refusal(Code.REFUSED, f"{what} was ended from outside ({ended})")
        if process.returncode != 0:
            raise RuntimeError(f"{what} failed aside:\n{err}")
        said: Mapping[str, Any] = json.loads(out)
        if "error" in said:
            raise Refusal(Code.REFUSED, said["error"], hint=said["hint"])
        return said["result"]

    def _start(self) -> subprocess.Popen[str]:
        with self._lock:
            if self._closed:
                raise Refusal(Code.CONFLICT, "the daemon is ending")
            if self._process is not None:
                raise Refusal(Code.BUSY, "another calculation is under way", hint="ask again")
            self._process = subprocess.Popen(
                # Without -P the folder it is started in could bring modules of its own.
                [sys.executable, "-P", "-m", "rigd.daemon.serve.tied", str(os.getpid()),
                 sys.executable, "-P", "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                # Threads of the linear algebra would wait for one another, and for the run.
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"},
                start_new_session=True,
            )  # fmt: skip
            return self._process


def _dry_run(job: Mapping[str, Any]) -> DryRun:
    from dataclasses import asdict

    from rigd.config.loader import parse_rig
    from rigd.procedure.compile import compile_procedure
    from rigd.procedure.loader import parse_procedure
    from rigd.rehearsal import rehearse
    from rigd.remote.protocol.results import PeakView, StepView

    rig = parse_rig(job["rig"], Path(job["rig_path"]))
    source = parse_procedure(job["procedure"], Path("procedure"))
    procedure = compile_procedure(source, rig, job["set"])
    found = rehearse(procedure, rig, seed=1)
    return DryRun(
        ok=not found.refusals,
        duration_s=found.duration_s,
        trials=len(procedure.trials),
        steps=tuple(StepView(**asdict(step)) for step in found.steps),
        peaks=tuple(
            PeakView(
                channel=peak.channel,
                unit=peak.unit,
                lowest=_finite(peak.lowest),
                highest=_finite(peak.highest),
                low=_finite(peak.low),
                high=_finite(peak.high),
                limit_by=peak.limit_by,
                inside=peak.inside,
            )
            for peak in found.peaks
        ),
        refusals=found.refusals,
    )


def _identify(job: Mapping[str, Any]) -> Reported:
    from rigd.evaluate.evaluation import evaluate

    recording = Path(job["recording"])
    return _write(recording, recording.with_suffix(".html"), evaluate([recording]).report())


def _draw(job: Mapping[str, Any]) -> Reported:
    from rigd.daemon.serve.recordings import page_of
    from rigd.evaluate.run import run_report

    recording = Path(job["recording"])
    return _write(recording, page_of(recording), run_report(recording))


def _write(recording: Path, report: Path, text: str) -> Reported:
    draft = report.with_suffix(".html.new")
    draft.write_text(text, encoding="utf-8")
    draft.replace(report)  # whoever reads it meanwhile has the old one, whole
    return Reported(run=recording.name, size=report.stat().st_size)


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def main() -> int:
    """Do the job on standard input."""
    os.nice(NICENESS)
    job: Mapping[str, Any] = json.load(sys.stdin)
    work = {"dry_run": _dry_run, "identify": _identify, "draw": _draw}[job["do"]]
    try:
        said: Mapping[str, object] = {"result": work(job).model_dump(mode="json")}
    except RigdError as error:
        said = {"error": error.message, "hint": error.hint}
    json.dump(said, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
