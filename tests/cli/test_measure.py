"""``rigd measure``, and what a procedure measures in a run: tables, verdicts, exit codes."""

from __future__ import annotations

import csv
from pathlib import Path
from xml.etree import ElementTree

import pytest
from support.commands.command import rigd

#: The belt holds the carriage, so the speed of the wheel is that of the encoder's noise.
PROCEDURE = """\
procedure: hold
title: Holds the wheel with a current
doc: For tests.
parameters:
  current: {doc: Current, unit: mA}
sweep: {grid: {current: [100 mA, 200 mA]}}
repeats: 3
trial:
  steps:
    - step: rise
      set: {wheel_servo.current: {ramp: {from: 0 A, to: "${current}", over: 0.1 s}}}
      for: 0.15 s
    - step: steady
      set: {wheel_servo.current: "${current}"}
      for: 0.3 s
finish:
  - step: stop
    set: {wheel_servo.current: 0 A}
    for: 0.1 s
measure:
  current: {mean: wheel_servo.current, during: steady, unit: mA}
  reached: {duration: {to: wheel_servo.current > 50 mA}, during: rise, unit: ms}
  late: {channel: wheel_servo.current, when: wheel_servo.current > 0.15 A, during: rise}
accept:
  current: ["${current} - 20 mA", "${current} + 20 mA"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, what its run printed, and procedures that demand otherwise."""
    folder = tmp_path_factory.mktemp("measure")
    (folder / "hold.yaml").write_text(PROCEDURE)
    (folder / "strict.yaml").write_text(
        PROCEDURE.replace('["${current} - 20 mA", "${current} + 20 mA"]', "{min: 150 mA}")
    )
    never = "  never: {channel: wheel_servo.current, when: carriage.position > 1 m}\naccept:"
    (folder / "never.yaml").write_text(PROCEDURE.replace("accept:", never))
    unread = (folder / "never.yaml").read_text() + "  never: {min: 0 A}\n"
    (folder / "unread.yaml").write_text(unread)
    ended = rigd("run", "hold.yaml", "--rig", "lugre-1", "--output", "a.mcap",
                 "--junit", "a.xml", cwd=folder)  # fmt: skip
    assert ended.code == 0, ended.err
    (folder / "out.txt").write_text(ended.out)
    return folder


def cases(path: Path) -> dict[str, str]:
    """Return the failure of each test case by its name; "" if it passed."""
    return {
        case.get("name", ""): "".join(item.get("message", "") for item in case.findall("failure"))
        for case in ElementTree.parse(path).getroot().iter("testcase")
    }


def test_run_prints_measures_and_verdict(folder: Path) -> None:
    out = (folder / "out.txt").read_text()
    assert "current 100 mA" in out
    assert "repeatability only (type A)" in out
    assert "late: wheel_servo.current > 0.15 A never came (trial 1, 2, 3)" in out
    assert "accepted" in out


def test_run_writes_case_for_each_result(folder: Path) -> None:
    found = cases(folder / "a.xml")
    assert {name: text for name, text in found.items() if name.startswith("measure")} == {
        "measure current, current 100 mA": "", "measure current, current 200 mA": "",
    }  # fmt: skip


def test_recorded_measures_are_read_again(folder: Path) -> None:
    ended = rigd("measure", "a.mcap", "--json", cwd=folder)
    assert ended.code == 0
    results = ended.json["results"]
    assert ended.json["verdict"] == "accepted"
    current = [item for item in results if item["measure"] == "current"]
    assert [item["setpoints"] for item in current] == [
        {"current": "100 mA"}, {"current": "200 mA"},
    ]  # fmt: skip
    assert [item["count"] for item in current] == [3, 3]
    assert [item["mean"] for item in current] == pytest.approx([0.1, 0.2], abs=0.01)
    assert current[0]["low"] < current[0]["mean"] < current[0]["high"]
    assert current[0]["accept"] == pytest.approx([0.08, 0.12])


def test_measure_read_in_no_trial_fails(folder: Path) -> None:
    ended = rigd("measure", "a.mcap", "--plan", "never.yaml", "--junit", "n.xml", cwd=folder)
    assert ended.code == 9
    assert "never: carriage.position > 1 m never came (trial 1, 2, 3, 4, 5, 6)" in ended.out
    assert ended.out.endswith("accepted\nread in no trial: never\n")
    assert cases(folder / "n.xml")["measure never, current 100 mA"].startswith("not read: mean –")
    results = rigd("measure", "a.mcap", "--plan", "never.yaml", "--json", cwd=folder).json
    never = next(item for item in results["results"] if item["measure"] == "never")
    assert (never["mean"], never["verdict"], never["count"]) == (None, None, 0)
    assert never["trials"][0]["reason"] == "carriage.position > 1 m never came"


def test_rejected_result_has_exit_code_nine(folder: Path) -> None:
    ended = rigd("measure", "a.mcap", "--plan", "strict.yaml", "--junit", "b.xml", cwd=folder)
    assert ended.code == 9
    assert "rejected" in ended.out
    failures = cases(folder / "b.xml")
    assert failures["measure current, current 200 mA"] == ""
    assert failures["measure current, current 100 mA"].startswith("rejected: mean ")
    assert "must be at least 150" in failures["measure current, current 100 mA"]


def test_unread_result_is_not_decided(folder: Path) -> None:
    ended = rigd("measure", "a.mcap", "--plan", "unread.yaml", cwd=folder)
    assert ended.code == 9
    assert "not decided" in ended.out
    assert "it could be read in no trial" in ended.out


def test_run_with_rejected_result_fails(folder: Path) -> None:
    ended = rigd("run", "strict.yaml", "--rig", "lugre-1", "--output", "c.mcap", "--json",
                 cwd=folder)  # fmt: skip
    assert ended.code == 9
    assert ended.json["exit_code"] == 9
    assert ended.json["measures"]["verdict"] == "rejected"


def test_verdict_of_a_run_is_found(folder: Path) -> None:
    found = rigd("runs", ".", "--where", "verdict == accepted", "--json", cwd=folder).json
    assert [(item["recording"], item["verdict"]) for item in found] == [("a.mcap", "accepted")]
    assert rigd("verify", "a.mcap", cwd=folder).code == 0


def test_dry_run_measures_nothing(folder: Path) -> None:
    ended = rigd("run", "strict.yaml", "--rig", "lugre-1", "--dry-run", cwd=folder)
    assert ended.code == 0


def test_dry_run_names_options_without_effect(folder: Path) -> None:
    given = ["--output", "x.mcap", "--pace", "2", "--ask", "--compression", "zstd"]
    ended = rigd("run", "strict.yaml", "--rig", "lugre-1", "--dry-run", *given, cwd=folder)
    assert ended.code == 0
    assert "nobody: --output, --pace, --ask, --compression\n" in ended.err
    assert not (folder / "x.mcap").exists()


def test_table_of_trials_has_measures(folder: Path) -> None:
    ended = rigd("export", "a.mcap", "--to", "csv", "--stream", "carriage", "--output", "tables",
                 cwd=folder)  # fmt: skip
    assert ended.code == 0, ended.err
    with (folder / "tables" / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    values = [float(row["measure_current [A]"]) for row in rows]
    assert values == pytest.approx([0.1] * 3 + [0.2] * 3, abs=0.01)
    assert {row["measure_late [A]"] for row in rows[:3]} <= {"", "nan", "NaN"}


def test_page_of_run_shows_measures(folder: Path) -> None:
    ended = rigd("report", "a.mcap", "--output", "a.html", cwd=folder)
    assert ended.code == 0, ended.err
    page = (folder / "a.html").read_text()
    assert 'id="measures"' in page
    assert "accepted" in page
    assert "wheel_servo.current &gt; 0.15 A never came" in page


def test_recording_without_measures_is_refused(folder: Path) -> None:
    (folder / "plain.yaml").write_text(PROCEDURE[: PROCEDURE.index("measure:")])
    ended = rigd("measure", "a.mcap", "--plan", "plain.yaml", cwd=folder)
    assert ended.code == 7
    assert "measures nothing" in ended.err


def test_file_given_twice_is_refused(folder: Path) -> None:
    ended = rigd("measure", "a.mcap", "a.mcap", cwd=folder)
    assert ended.code == 7
    assert "a.mcap is given twice" in ended.err
