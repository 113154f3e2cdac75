"""``rigd run --junit``: a test case for each trial, and one for the run."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from support.commands.command import rigd

from rigd.cli.views.junit import JunitCase, Suite, case_of, suite_of_error, write_junit
from rigd.engine.run.result import RunResult
from rigd.model.errors import Blocked, Exit
from rigd.model.states import RunState

#: What may stand in each element, by the schema of the xUnit plugin of Jenkins (junit-10.xsd).
CHILDREN = {
    "testsuites": {"testsuite"},
    "testsuite": {"properties", "testcase"},
    "properties": {"property"},
    "testcase": {"failure", "error", "skipped"},
}
_COUNTS = {"tests", "failures", "errors"}
ATTRIBUTES = {
    "testsuites": {"name", "time"} | _COUNTS,
    "testsuite": {"name", "time", "skipped", "timestamp"} | _COUNTS,
    "property": {"name", "value"},
    "testcase": {"name", "classname", "time"},
    **{kind: {"message", "type"} for kind in ("failure", "error", "skipped")},
}

#: Three trials of the wheel, held by the belt.
SHAKE = """\
procedure: shake
title: Turns the wheel
doc: For tests.
parameters:
  current: {doc: Amplitude, unit: A}
sweep: {grid: {current: [0.1 A, 0.2 A, 0.3 A]}}
trial:
LIMITS
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: "${current}", frequency: 5 Hz}}}
      for: 0.4 s
finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.1 s
"""


def run(folder: Path, limits: str = "", *words: str) -> tuple[int, ElementTree.Element]:
    """Run the procedure and return the exit code and the suite."""
    (folder / "shake.yaml").write_text(SHAKE.replace("LIMITS\n", limits))
    ended = rigd(
        "run", "shake.yaml", "--rig", "lugre-1", "--junit", "out.xml", *words, cwd=folder
    )  # fmt: skip
    return ended.code, read(folder / "out.xml")


def read(path: Path) -> ElementTree.Element:
    """Return the only suite of a file that is valid."""
    root = ElementTree.parse(path).getroot()
    assert root.tag == "testsuites"
    for element in root.iter():
        assert set(element.keys()) <= ATTRIBUTES.get(element.tag, set())
        assert {child.tag for child in element} <= CHILDREN.get(element.tag, set())
    (suite,) = root
    return suite


def outcomes(suite: ElementTree.Element) -> dict[str, str]:
    return {
        case.get("name", ""): case[0].tag if len(case) else "passed"
        for case in suite.iter("testcase")
    }


def test_each_trial_is_a_case_with_its_time(tmp_path: Path) -> None:
    code, suite = run(tmp_path)
    assert code == 0
    assert outcomes(suite) == {
        "trial 1: current 0.1 A": "passed",
        "trial 2: current 0.2 A": "passed",
        "trial 3: current 0.3 A": "passed",
        "run": "passed",
    }
    assert (suite.get("name"), suite.get("tests"), suite.get("failures")) == ("shake", "4", "0")
    times = [float(case.get("time", "nan")) for case in suite.iter("testcase")]
    assert all(0.39 < time_s < 0.6 for time_s in times[:3])
    assert times[3] > sum(times[:3])
    assert suite.get("timestamp", "")[:2] == "20"
    properties = {item.get("name"): item.get("value") for item in suite.iter("property")}
    assert properties["rig"] == "lugre-1"
    recording = properties["recording"] or ""
    words = ("run", "--resume", recording, "--junit", "again.xml")
    assert rigd(*words, cwd=tmp_path).code == 0
    assert outcomes(read(tmp_path / "again.xml")) == outcomes(suite)


def test_trial_that_ended_early_fails_with_its_reason(tmp_path: Path) -> None:
    limits = "  limits: {wheel_servo.current: {low: -0.25 A, high: 0.25 A}}\n"
    code, suite = run(tmp_path, limits)
    assert code == 6
    assert outcomes(suite) == {
        "trial 1: current 0.1 A": "passed",
        "trial 2: current 0.2 A": "passed",
        "trial 3: current 0.3 A": "failure",
        "run": "failure",
    }
    failed = suite.find("testcase[3]/failure")
    assert failed is not None
    assert "wheel_servo.current" in failed.get("message", "")
    assert suite.get("failures") == "2"


def test_failure_outside_procedure_is_an_error() -> None:
    def outcome(ending: str, code: Exit) -> tuple[str, str]:
        case = case_of(RunResult(RunState.IDLE, ending, "why", code, 0, 1, 2.0, trips=("trip",)))
        return case.failure, case.error

    assert outcome("complete", Exit.OK) == ("", "")
    assert outcome("tripped", Exit.TRIPPED) == ("tripped: why\ntrip", "")
    assert outcome("incomplete", Exit.FAILED) == ("incomplete: why\ntrip", "")
    for ending, code in (("faulted", Exit.TRIPPED), ("blocked", Exit.BLOCKED),
                         ("estopped", Exit.STOPPED)):  # fmt: skip
        assert outcome(ending, code) == ("", f"{ending}: why\ntrip")


def test_file_that_is_wrong_is_error_of_run(tmp_path: Path) -> None:
    code, suite = run(tmp_path, "", "--set", "curent=1 A")
    assert code == 2
    assert outcomes(suite) == {"run": "error"}
    error = suite.find("testcase/error")
    assert error is not None and "curent" in error.get("message", "")


def test_unwritable_junit_file_prevents_the_run(tmp_path: Path) -> None:
    words = ("run", "quick", "--rig", "lugre-1", "--junit")
    (tmp_path / "folder").mkdir()
    assert "--junit folder is a folder" in rigd(*words, "folder", cwd=tmp_path).err
    (tmp_path / "file").write_text("")
    refused = rigd(*words, "file/out.xml", cwd=tmp_path)
    assert "cannot make the folder file: " in refused.err
    assert rigd(*words, "out.xml", "--dry-run", cwd=tmp_path).code == 2
    assert {item.name for item in tmp_path.iterdir()} == {"folder", "file"}


def test_characters_not_allowed_in_xml_are_replaced(tmp_path: Path) -> None:
    path = tmp_path / "out.xml"
    write_junit(path, Suite("odd", [JunitCase("a\x00<b>", failure='first "&"\nsecond\x1b')]))
    case = ElementTree.parse(path).getroot().find("testsuite/testcase")
    assert case is not None
    assert case.get("name") == "a�<b>"
    assert (case[0].get("message"), case[0].text) == ('first "&"', "second�")


def test_trials_that_were_not_played_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "out.xml"
    write_junit(
        path, Suite("s", [JunitCase("one"), JunitCase("two", skipped="not played: stopped")])
    )
    suite = ElementTree.parse(path).getroot()[0]
    assert outcomes(suite) == {"one": "passed", "two": "skipped"}
    assert suite.get("skipped") == "1"


def test_blocked_preflight_is_an_error_with_all_reasons(tmp_path: Path) -> None:
    path = tmp_path / "out.xml"
    write_junit(path, suite_of_error("shake", Blocked(["no watchdog", "no calibration"])))
    error = read(path).find("testcase/error")
    assert error is not None
    assert "no watchdog" in error.get("message", "")
    assert "no calibration" in (error.text or "")
