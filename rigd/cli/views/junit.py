"""Writes the result of a run as JUnit XML for continuous integration.

Each trial is one test case. One more test case represents the run as a whole. It also fails if a
part fails that belongs to no trial: preflight, `prepare`, `finish` or the recording. The module
writes the elements and attributes that Jenkins and GitLab read (JUnit 10 schema of the Jenkins
xUnit plugin).
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.daemon.execute import RecordedRun
from rigd.daemon.provenance import trial_label
from rigd.engine.run.result import RunResult
from rigd.model.errors import ConfigError, Exit, RigdError
from rigd.model.machine.folders import make_folder
from rigd.procedure.program import CompiledProcedure
from rigd.record import Recording, TrialInfo

if TYPE_CHECKING:
    from rigd.analysis.measures import MeasureResult

#: Endings that are no result of the procedure: the rig was not fit, or a device failed.
_NOT_ITS_DOING: Final = frozenset({"blocked", "faulted"})
#: Characters that XML 1.0 cannot contain in any form (section 2.2).
_NOT_XML: Final = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class JunitCase:
    """One test case; with no ``failure``, ``error`` or ``skipped`` it has passed."""

    name: str
    time_s: float = 0.0
    failure: str = ""  #: the step did not end as the procedure demands
    error: str = ""  #: the trial could not be played
    skipped: str = ""  #: the trial was not played


@dataclass(frozen=True)
class Suite:
    """All cases of a run."""

    name: str
    cases: Sequence[JunitCase]
    properties: Mapping[str, str] = field(default_factory=dict)
    started: str = ""  #: ISO 8601


def suite_of(
    procedure: CompiledProcedure,
    rig: str,
    recorded: RecordedRun,
    measured: MeasureResult | None = None,
) -> Suite:
    """Return the results of the run, of each trial and of each measure, from its recording.

    Raises:
        RecordingError: the recording cannot be read.
    """
    result = recorded.result
    ended = f"{result.ending}: {result.reason}"
    suite = _suite(procedure, rig, recorded.path, case_of(result), ended)
    if measured is None:
        return suite
    *trials, run = suite.cases
    return replace(suite, cases=[*trials, *cases_of_measures(measured), run])


def case_of(result: RunResult) -> JunitCase:
    """Return the case of the run as a whole.

    It is an error, not a failure, if the ending is no result of the procedure: a person ended the
    run, or the rig was not fit.
    """
    description = "\n".join((f"{result.ending}: {result.reason}", *result.trips, *result.problems))
    if result.exit_code is Exit.OK:
        return JunitCase("run", result.run_s)
    if result.exit_code is Exit.STOPPED or result.ending in _NOT_ITS_DOING:
        return JunitCase("run", result.run_s, error=description)
    return JunitCase("run", result.run_s, failure=description)


def suite_of_complete(procedure: CompiledProcedure, rig: str, path: Path) -> Suite:
    """Return the results of a recording in which no trial is missing, so that nothing is played.

    Raises:
        RecordingError: the recording cannot be read.
    """
    return _suite(procedure, rig, path, JunitCase("run"), "complete: all trials were played before")


def cases_of_measures(result: MeasureResult) -> list[JunitCase]:
    """Return a case for each result of which something is demanded, or which has no value at all.

    One that is not decided fails as well: it does not show that the result is right.
    """
    from rigd.analysis.measures import Judgement
    from rigd.analysis.measures.view import label, verdict_text

    return [
        JunitCase(
            f"measure {label(item)}",
            failure="" if item.judgement is Judgement.ACCEPTED else verdict_text(item),
        )
        for item in result.summaries
        if item.judgement is not None or item.measure.name in result.unread
    ]


def suite_of_error(procedure: str, error: RigdError) -> Suite:
    """Return the suite of a run that did not start."""
    return Suite(procedure, [JunitCase("run", error=str(error))])


def check_writable(path: Path) -> None:
    """Check before anything moves that the result can be written; make its folder.

    Raises:
        ConfigError: it is a folder.
        RecordingError: its folder cannot be made.
    """
    if path.is_dir():
        raise ConfigError(f"--junit {path} is a folder")
    make_folder(path.parent, "--junit")


def write_junit(path: Path, suite: Suite) -> None:
    """Write ``suite`` to ``path``.

    Raises:
        ConfigError: it cannot be written.
    """
    counts = {
        "tests": str(len(suite.cases)),
        "failures": str(sum(bool(case.failure) for case in suite.cases)),
        "errors": str(sum(bool(case.error) for case in suite.cases)),
    }
    root = ET.Element("testsuites", counts)  # the schema requires this element
    top = ET.SubElement(root, "testsuite", {"name": _clean(suite.name), **counts})
    top.set("skipped", str(sum(bool(case.skipped) for case in suite.cases)))
    if suite.cases:
        top.set("time", f"{suite.cases[-1].time_s:.3f}")  # the case of the run itself is the last
    if suite.started:
        top.set("timestamp", suite.started)
    if suite.properties:
        properties = ET.SubElement(top, "properties")
        for name, value in suite.properties.items():
            ET.SubElement(properties, "property", {"name": name, "value": _clean(value)})
    for case in suite.cases:
        _add(top, _clean(suite.name), case)
    ET.indent(root)
    try:
        ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise ConfigError(f"--junit {path}: cannot be written: {error.strerror}") from error


def _suite(procedure: CompiledProcedure, rig: str, path: Path, run: JunitCase, ended: str) -> Suite:
    info = Recording.open(path).info
    played = {trial.number: trial for trial in info.trials}  # the last attempt counts
    cases = [
        _trial(plan.number, trial_label(plan, procedure), played.get(plan.number), ended)
        for plan in procedure.trials
    ]
    ending, _, _ = ended.partition(":")
    properties = {"rig": rig, "recording": str(path), "ending": ending}
    return Suite(procedure.name, [*cases, run], properties, info.started)


def _trial(number: int, label: str, trial: TrialInfo | None, ended: str) -> JunitCase:
    name = f"trial {number}: {label}" if label else f"trial {number}"
    if trial is None:
        return JunitCase(name, skipped=f"not played: {ended}")
    if trial.end_ns is None:
        return JunitCase(name, failure=f"the run ended during this trial: {ended}")
    time_s = (trial.end_ns - trial.start_ns) * 1e-9
    return JunitCase(name, time_s, failure="" if trial.complete else trial.reason or ended)


def _add(top: ET.Element, suite: str, case: JunitCase) -> None:
    name = _clean(case.name)
    element = ET.SubElement(
        top, "testcase", {"classname": suite, "name": name, "time": f"{case.time_s:.3f}"}
    )
    outcomes = {"failure": case.failure, "error": case.error, "skipped": case.skipped}
    for kind, description in outcomes.items():
        if not description:
            continue
        message, _, rest = _clean(description).partition("\n")
        if message.endswith(":"):  # the first of several reasons, as there is only one line
            message += " " + rest.partition("\n")[0].strip()
        ET.SubElement(element, kind, {"message": message}).text = rest or None


def _clean(text: str) -> str:
    return _NOT_XML.sub("�", text)
