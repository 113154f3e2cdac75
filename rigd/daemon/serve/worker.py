"""Runs checks, dry runs and analyses in a worker process with limits on time and memory.

``python -m rigd.daemon.serve.worker`` reads one job as JSON, executes it at low priority, and
prints the result, or the error, as JSON.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rigd.config.rig import RigConfig
from rigd.engine.system.child import Child, module
from rigd.engine.system.realtime import set_nice
from rigd.model.errors import ConfigError, RigdError
from rigd.model.machine.extras import require
from rigd.remote.protocol import Code, Message, Refusal
from rigd.remote.protocol.results import CheckReport, DryRun, RenewedCalibration, Reported

#: A calculation that takes longer is cancelled: a little before its client stops waiting, in s.
PATIENCE_S: Final = 890.0
#: How often to check whether the client is still connected, in s.
_LOOK_S: Final = 0.2
#: Memory that a calculation may take, in bytes.
MEMORY: Final = 4 << 30
#: Low priority: the run in progress, clients and panels come first.
NICENESS: Final = 15


class CalculationWorker:
    """Does one calculation at a time; :meth:`close` cancels the present one.

    A calculation is also cancelled if it takes longer than ``patience_s``, needs more than
    ``memory`` (in bytes), or its client has disconnected.
    """

    def __init__(self, patience_s: float = PATIENCE_S, memory: int = MEMORY) -> None:
        self._patience_s = patience_s
        self._memory = memory
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._doing = ""  # what the child calculates
        self._cancelled = ""  # why it was cancelled
        self._closed = False

    def dry_run(
        self, rig: str, rig_path: Path, procedure: str, name: str, settings: Mapping[str, str]
    ) -> DryRun:
        """Play a procedure on the plant of a rig or of its sibling, both given as texts.

        ``name`` is the name of the procedure in errors.

        Raises:
            Refusal: it cannot be played, or took too long.
        """
        job = _job(rig, rig_path, procedure, name, settings)
        return DryRun.model_validate_json(json.dumps(self._do("dry_run", job)))

    def check(
        self, rig: str, rig_path: Path, procedure: str, name: str, settings: Mapping[str, str]
    ) -> CheckReport:
        """Return whether a procedure can run on a rig, both given as texts.

        Raises:
            Refusal: it took too long, or too much memory.
        """
        job = _job(rig, rig_path, procedure, name, settings)
        return CheckReport.model_validate_json(json.dumps(self._do("check", job)))

    def identify(self, recording: Path) -> Reported:
        """Run the analysis of a recording, and write the report beside it.

        Raises:
            Refusal: the data do not permit it, or it took too long.
        """
        result = self._do("identify", {"recording": str(recording)})
        return Reported.model_validate_json(json.dumps(result))

    def calibrate(
        self, rig: str, rig_path: Path, recording: Path, operator: str, days: int, *, write: bool
    ) -> RenewedCalibration:
        """Return what a recording makes of the calibration of a rig, given as text; ``write`` it.

        ``operator`` is the person responsible, ``days`` for how long the values may be used.

        Raises:
            Refusal: the data are no calibration, the file cannot be written, or it took too long.
        """
        job = {
            "rig": rig, "rig_path": str(rig_path), "recording": str(recording),
            "operator": operator, "days": days, "write": write,
        }  # fmt: skip
        return RenewedCalibration.model_validate_json(json.dumps(self._do("calibrate", job)))

    def draw(self, recording: Path) -> Reported:
        """Draw a recording, and write the page beside it.

        Raises:
            Refusal: it cannot be read, or it took too long.
        """
        result = self._do("draw", {"recording": str(recording)})
        return Reported.model_validate_json(json.dumps(result))

    def compare(self, recordings: Sequence[Path]) -> str:
        """Return the page of a comparison of recordings, which are in one folder.

        Raises:
            Refusal: they cannot be compared, or it took too long.
        """
        job = {
            "folder": str(recordings[0].parent),
            "recordings": [path.name for path in recordings],
        }
        return _Page.model_validate_json(json.dumps(self._do("compare", job))).text

    def cancel(self, what: str, why: str) -> None:
        """Cancel the present calculation if it is ``what``, such as a dry run."""
        with self._lock:
            if self._child is not None and self._doing == what and not self._cancelled:
                self._cancelled = why
                self._child.fence(0.0)  # the thread that waits for its output sees its end

    def close(self) -> None:
        """Cancel the present calculation; no other begins."""
        with self._lock:
            self._closed = True
            if self._child is not None:
                self._child.fence(0.0)  # the thread that waits for its output sees its end

    def _do(self, what: str, job: Mapping[str, object]) -> object:
        child = self._start(what)
        cancelled = ""
        try:
            order = json.dumps({"do": what, "memory": self._memory, **job})
            out, errors = self._wait(child, what, order)
        finally:
            with self._lock:
                self._child, cancelled = None, self._cancelled
        if self._closed:
            raise Refusal(Code.CONFLICT, "the daemon is ending")
        if cancelled:
            raise Refusal(Code.REFUSED, f"{what} was cancelled: {cancelled}")
        if child.code == -signal.SIGABRT:  # compiled code ends so if it gets no memory
            raise Refusal(Code.REFUSED, _too_much(what, self._memory))
        if (
            child.code is not None and child.code < 0
        ):  # killed by a person, or by the kernel for lack of memory
            raise Refusal(Code.REFUSED, f"{what} {child.ended}")
        if child.code != 0:
            raise RuntimeError(f"{what} failed in its own process:\n{errors}")
        answer: Mapping[str, Any] = json.loads(out)
        if "error" in answer:
            raise Refusal(Code(answer["code"]), answer["error"], hint=answer["hint"])
        return answer["result"]

    def _wait(self, child: Child, what: str, order: str) -> tuple[str, str]:
        """Return the output and error output of the process after its end.

        Raises:
            Refusal: it took too long, or its client disconnected; the process is killed.
        """
        from rigd.remote.server import still_connected  # the process itself needs no network

        give_up_s = time.monotonic() + self._patience_s
        given: str | None = order
        while True:
            outputs = child.talk(given, _LOOK_S)
            if outputs is not None:
                return outputs
            given = None  # it has its input
            gone = not still_connected()
            if not gone and time.monotonic() < give_up_s:
                continue
            child.fence(None)
            child.talk(None, _LOOK_S)  # closes its pipes; the output is discarded
            took = "its client is gone" if gone else f"it took longer than {self._patience_s:g} s"
            raise Refusal(Code.REFUSED, f"{what} was cancelled: {took}")

    def _start(self, what: str) -> Child:
        with self._lock:
            if self._closed:
                raise Refusal(Code.CONFLICT, "the daemon is ending")
            if self._child is not None:
                raise Refusal(Code.BUSY, "another calculation is under way", hint="ask again")
            self._doing, self._cancelled = what, ""
            self._child = Child(
                module(__name__),
                tied=True,
                stdin=True,
                output=True,
                # One thread of linear algebra: more would wait for one another, and for the run.
                environment={"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"},
            )
            return self._child


def _job(
    rig: str, rig_path: Path, procedure: str, name: str, settings: Mapping[str, str]
) -> dict[str, object]:
    return {
        "rig": rig,
        "rig_path": str(rig_path),
        "procedure": procedure,
        "name": name,
        "set": dict(settings),
    }


def _read_rig(job: Mapping[str, Any]) -> RigConfig:
    """Return the rig of a job, with all modules that a check loads."""
    from rigd.config.loader import parse_rig
    from rigd.daemon.serve import library  # noqa: F401

    return parse_rig(job["rig"], Path(job["rig_path"]))


def _check(job: Mapping[str, Any]) -> CheckReport:
    from rigd.daemon.serve.library import check
    from rigd.remote.protocol.arguments import Checked, ProcedureFile

    file = ProcedureFile.of(job["name"], job["procedure"])
    return check(Checked(procedure=file, set=job["set"]), job["rig"])


def _dry_run(job: Mapping[str, Any]) -> DryRun:
    from dataclasses import asdict

    from rigd.analysis.plan import judged
    from rigd.daemon.rehearsal import rehearse
    from rigd.procedure.loader import parse_procedure
    from rigd.remote.protocol.results import DifferenceView, PeakView, StepView

    rig: RigConfig = job["rig"]
    source = parse_procedure(job["procedure"], Path(f"{job['name']}.yaml"))
    procedure = judged(source, rig, job["set"])
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
                display=peak.display,
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
        physics=found.physics,
        sibling=found.sibling,
        known_s=found.known_s,
        differences=tuple(DifferenceView(**asdict(item)) for item in found.differences),
        notes=found.notes,
    )


def _identify(job: Mapping[str, Any]) -> Reported:
    require("analysis", "this daemon")
    from rigd.analysis.evaluation import evaluate

    recording = Path(job["recording"])
    return _write(recording, recording.with_suffix(".html"), evaluate([recording]).report())


def _calibrate(job: Mapping[str, Any]) -> RenewedCalibration:
    require("analysis", "this daemon")
    from rigd.daemon.calibrate import Signature, evaluated, place_of, renewal, spread
    from rigd.remote.protocol.results import RenewedValue

    rig: RigConfig = job["rig"]
    place = place_of(rig)
    if place.shipped is not None:
        raise ConfigError(
            f"{place.shipped.name} is shipped with rigd and stays as it is",
            hint="serve a copy of the rig file: its calibration stands beside the copy then",
        )
    evaluation = evaluated(Path(job["recording"]), rig, place)
    planned = renewal(
        rig, place, evaluation, Signature.of(evaluation, job["operator"], job["days"])
    )
    if job["write"]:
        planned.write()
    values = []
    for name in planned.measured:
        now, was = planned.new.values[name], planned.was(name)
        deviation = planned.deviation(name)
        values.append(
            RenewedValue(
                name=name,
                unit=now.unit,
                new=spread(now),
                old="" if was is None else spread(was),
                deviation=None if was is None else _finite(deviation),
            )
        )
    return RenewedCalibration(
        file=place.path.name,
        values=tuple(values),
        operator=job["operator"],
        valid_until=planned.signature.valid_until.isoformat(),
        remarks=tuple(planned.remarks()),
        written=job["write"],
    )


def _draw(job: Mapping[str, Any]) -> Reported:
    require("analysis", "this daemon")
    from rigd.analysis.run_page import run_report
    from rigd.model.pages import page_of

    recording = Path(job["recording"])
    return _write(recording, page_of(recording), run_report(recording))


class _Page(Message):
    """A page that is not written to a file."""

    text: str


def _compare(job: Mapping[str, Any]) -> _Page:
    require("analysis", "this daemon")
    from rigd.analysis.compare.api import compare

    os.chdir(job["folder"])  # the page must not show paths of this machine
    return _Page(text=compare(*job["recordings"]).evaluation.report())


def _write(recording: Path, report: Path, text: str) -> Reported:
    draft = report.with_suffix(".html.new")
    draft.unlink(missing_ok=True)
    with draft.open("x", encoding="utf-8") as file:  # never through a symbolic link of this name
        file.write(text)
    draft.replace(report)  # a process that reads it meanwhile keeps the complete old file
    return Reported(run=recording.name, size=report.stat().st_size)


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _too_much(what: str, memory: int) -> str:
    return f"{what} needs more than {memory >> 20} MB of memory"


def _refused(code: Code, error: str, hint: str | None = None) -> dict[str, object]:
    return {"error": error, "hint": hint, "code": code.value}


def main() -> int:
    """Do the job on standard input."""
    set_nice(NICENESS)
    job: Mapping[str, Any] = json.load(sys.stdin)
    memory: int = job["memory"]
    work: Mapping[str, Callable[[Mapping[str, Any]], Message]] = {
        "calibrate": _calibrate, "check": _check, "compare": _compare, "draw": _draw,
        "dry_run": _dry_run, "identify": _identify,
    }  # fmt: skip
    try:
        if "rig" in job:  # the daemon's own: the bound is for what a client sent
            job = {**job, "rig": _read_rig(job)}
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
        answer: Mapping[str, object] = {"result": work[job["do"]](job).model_dump(mode="json")}
    except ConfigError as error:
        answer = _refused(Code.WRONG, str(error))
    except RigdError as error:
        answer = _refused(Code.REFUSED, error.message, error.hint)
    except MemoryError:
        answer = _refused(Code.REFUSED, _too_much(job["do"], memory))
    json.dump(answer, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
