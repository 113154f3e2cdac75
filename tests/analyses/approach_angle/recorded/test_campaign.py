"""Recordings to the campaign: as one, under which calibration, and every bad run reported."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.approach_angle.headless import SimulatedRun, simulate
from support.approach_angle.recording import Recorded, calibration_of, write_campaign
from support.commands.command import rigd
from support.panel.markup import outline

from rigd.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.recordings.corrections import Corrections
from rigd.analysis.recordings.source import open_sweep
from rigd.analysis.terminal import TerminalReport, TerminalTable
from rigd.model.errors import ConfigError, DataError
from rigd_analyses.approach_angle.analysis import ApproachAngleAnalysis
from rigd_analyses.approach_angle.evaluation import CampaignEvaluation
from rigd_analyses.approach_angle.trial_check import check_trial

Evaluate = Callable[..., CampaignEvaluation]
Record = Callable[..., Path]


def texts(shown: TerminalReport) -> str:
    """Return all that a terminal shows."""
    lines = []
    for item in shown:
        rows = [row.cells for row in item.rows] if isinstance(item, TerminalTable) else [(item,)]
        lines += [" ".join(cells) for cells in rows]
    return "\n".join(lines)


def changed(recorded: Recorded, **signals: Any) -> Recorded:
    """Return ``one`` with other signals."""
    return replace(recorded, run=replace(recorded.run, **signals))


def before_the_trigger_removed(recorded: Recorded) -> Recorded:
    run = recorded.run
    kept = run.t_s >= 0.0
    names = ("t_s", "gauge_a_v", "gauge_b_v", "wheel_v", "platform_v")
    return changed(recorded, **{name: getattr(run, name)[kept] for name in names})


def watchdog(recorded: Recorded) -> Recorded:
    run = simulate("clean_0", 8.0, 4.0, seed=1, fault="platform_pot_dead")
    reason = "drive: not within 1.5 s: daq.platform_position is 0.00 m"
    return replace(recorded, run=as_run(run, recorded.run), complete=False, reason=reason)


def pot_at_end(recorded: Recorded) -> Recorded:
    end = simulate("clean_0", 4.0, 10.0, seed=3, fault="wheel_pot_at_end")
    return replace(recorded, run=as_run(end, recorded.run))


def as_run(run: SimulatedRun, other: SimulatedRun) -> SimulatedRun:
    """Return ``run`` as if it had been played instead of ``other``."""
    return replace(
        run,
        announced_load_kg=other.announced_load_kg,
        voltage_v=other.voltage_v,
        scale_kg=other.scale_kg,
    )


#: Each bad input: how it is made, the code of its flag, and words of its reason.
BAD: Mapping[str, tuple[Callable[[Recorded], Recorded], str, str]] = {
    "no pre-trigger": (before_the_trigger_removed, "no_pre_trigger", "before the relay command"),
    "swapped gauges": (
        lambda item: changed(item, gauge_a_v=item.run.gauge_b_v, gauge_b_v=item.run.gauge_a_v),
        "negative_torque", "",
    ),
    "swapped leads": (
        lambda item: changed(item, wheel_v=5.0 - item.run.wheel_v), "negative_speed", "",
    ),
    "pot at its end": (pot_at_end, "pot_at_end", ""),
    "scale never stable": (
        lambda item: replace(item, stable=False), "scale_unsteady", "not come to rest",
    ),
    "stopped by the watchdog": (watchdog, "watchdog", "stopped by time"),
    "ended early": (
        lambda item: replace(item, complete=False, reason="stopped by hand"),
        "incomplete", "stopped by hand",
    ),
    "never driven": (lambda item: replace(item, driven=False), "not_driven",
        "never commanded to close",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def good(
    campaign: Sequence[Recorded], calibration: str, tmp_path_factory: pytest.TempPathFactory
) -> CampaignEvaluation:
    """The good campaign, evaluated once."""
    path = tmp_path_factory.mktemp("good") / "campaign.mcap"
    write_campaign(path, campaign, calibration=calibration)
    found = evaluate([path])
    assert isinstance(found, CampaignEvaluation)
    return found


def test_records_without_pre_trigger_are_used_if_asked(
    campaign: Sequence[Recorded], record: Record
) -> None:
    path = record([before_the_trigger_removed(item) for item in campaign[:2]])
    found = evaluate([path], corrections=Corrections(constants={"pre_trigger": "0 s"}))
    assert isinstance(found, CampaignEvaluation)
    for run in found.result.runs:
        assert not run.excluded and run.better.mu > 0.0
        assert run.better.budget is not None
        assert "gauge zero" in {t.name for t in run.better.budget.terms if t.systematic}


def test_a_good_campaign_has_no_flag_that_excludes(good: CampaignEvaluation) -> None:
    assert [run.run.label for run in good.result.runs if run.excluded] == []
    assert [s.name for s in good.result.sets] == ["clean_0", "clean_15", "clean_45", "coated_0"]
    assert good.result.sets[1].published == 0.2475
    assert set(good.result.trends) == {"paper", "better", "published"}
    assert "24 runs, none of them left out" in texts(good.terminal_report())


def test_first_table_names_coefficient_of_every_number(good: CampaignEvaluation) -> None:
    table = good.terminal_report()[0]
    assert isinstance(table, TerminalTable)
    assert [column.title for column in table.columns] == [
        "set", "published", "paper's ± U", "(runs)", "corrected ± U (k=2)", "coefficient",
        "usable ± U",
    ]  # fmt: skip
    for row, item in zip(table.rows, good.result.sets, strict=True):
        assert row.cells[0] == item.name
        assert row.cells[1] == f"{item.published:.4f}"
        assert row.cells[3] == "6 used, 0 left out"
        assert row.cells[5] == "rolling-direction"
        assert item.maximum is not None
        value, _, expanded = row.cells[4].partition(" ± ")
        assert float(value) == pytest.approx(item.maximum.value, abs=1e-3)
        assert float(expanded) == pytest.approx(2 * item.maximum.u, rel=0.05)


@pytest.mark.parametrize("name", BAD)
def test_bad_run_is_in_json_terminal_and_report(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate, name: str
) -> None:
    spoil, code, words = BAD[name]
    found = analyse(record([*campaign[:5], spoil(campaign[5])]))
    told = found.to_json()
    runs = told["runs"]
    assert isinstance(runs, list)
    bad = runs[5]
    flag = next(flag for flag in bad["flags"] if flag["code"] == code)
    assert words in flag["reason"]
    assert bad["excluded"]
    assert bad["paper"]["mu"] is None
    assert bad["better"]["mu"] is None
    assert not any(run["excluded"] for run in runs[:5])
    json.dumps(told, allow_nan=False)
    assert f"{code} (1): trial 6 (clean_0, 4 kg, 10 V, repeat 2): " in texts(
        found.terminal_report()
    )
    assert flag["reason"].rstrip(".") in texts(found.terminal_report())
    page = found.report()
    assert flag["reason"] in unescape(page)
    assert "Trial 6, clean_0, 4 kg, 10 V, repeat 2" in unescape(page)
    assert outline(page).faults == []


def test_missing_repeat_is_reported(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate
) -> None:
    found = analyse(record(campaign[1:6], numbers=range(2, 7)))
    assert found.result.sets[0].missing == ("4 kg at 7 V: 1 of 2 repeats recorded",)
    for told in (texts(found.terminal_report()), found.report(), json.dumps(found.to_json())):
        assert "4 kg at 7 V: 1 of 2 repeats recorded" in told


def test_recordings_of_a_campaign_are_evaluated_together(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate, good: CampaignEvaluation
) -> None:
    first = record(campaign[:10], "first.mcap", state="stopped")
    second = record(campaign[10:], "second.mcap", numbers=range(11, 25))
    found = analyse(first, second)
    assert found.recordings == (first, second)
    for item, other in zip(found.result.sets, good.result.sets, strict=True):
        assert item.maximum == other.maximum
        assert item.paper == other.paper
    assert "first.mcap: the run did not come to its end (stopped" in found.result.warnings[0]
    assert "10 of 200 trials" in found.result.warnings[0]


def test_stopped_run_of_others_states_no_number(
    campaign: Sequence[Recorded], record: Record
) -> None:
    sweep = open_sweep(record(campaign[:2], state="stopped"))
    sweep = replace(sweep, info=replace(sweep.info, metadata={}))
    found = ApproachAngleAnalysis().evaluate([sweep], Options(), lambda line: None)
    assert isinstance(found, CampaignEvaluation)
    assert "2 of ? trials are complete" in found.result.warnings[0]


def test_interrupted_run_is_evaluated_and_reported(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate
) -> None:
    found = analyse(record(campaign[:6], state=""))
    assert "(interrupted)" in found.result.warnings[0]
    assert "(interrupted)" in texts(found.terminal_report())
    assert found.result.sets[0].paper.used == 6


def test_another_calibration_replays_the_raw_volts(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate, tmp_path: Path
) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(calibration_of(campaign[0].run, torque=1.02))
    path = record(campaign[:6])
    before, after = analyse(path), analyse(path, calibration=other)
    for item, two in zip(before.result.runs, after.result.runs, strict=True):
        assert two.paper.mu / item.paper.mu == pytest.approx(1.02, rel=1e-6)
        assert np.array_equal(item.run.gauge_a_v, two.run.gauge_a_v)
    (line,) = after.calibrations_told
    assert re.search(r"torque_scale: 2\.0\d{3} ± 0\.00\d\d N m/V -> 2\.0\d{3} ± ", line)
    assert "(+2.0 %)" in line
    for told in (texts(after.terminal_report()), unescape(after.report())):
        assert line in told
    assert "as recorded" in before.calibrations_told[0]
    told_json = after.to_json()["calibrations"]
    assert isinstance(told_json, list)
    assert told_json[0]["replayed"]
    assert "torque_scale" in told_json[0]["changes"][0]


def test_each_recording_has_its_own_calibration(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate, good: CampaignEvaluation
) -> None:
    wrong = calibration_of(campaign[0].run, torque=1.02)
    first = record(campaign[:6], "first.mcap")
    second = record(campaign[6:12], "second.mcap", calibration=wrong)
    found = analyse(first, second)
    pairs = zip(good.result.runs, found.result.runs, strict=False)
    ratios = [two.paper.mu / pair.paper.mu for pair, two in pairs]
    assert ratios == pytest.approx([1.0] * 6 + [1.02] * 6, rel=1e-6)
    assert len(found.calibrations_told) == 2


def test_a_recording_beside_its_copy_is_refused(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate
) -> None:
    earlier = record(campaign[:2], "earlier.mcap", state="stopped")
    whole = record(campaign[:4], "whole.mcap")
    with pytest.raises(DataError, match=r"trial 1 .*whole\.mcap .*earlier\.mcap"):
        analyse(earlier, whole)


def test_a_campaign_is_not_taken_apart_by_recording(
    campaign: Sequence[Recorded], record: Record
) -> None:
    paths = [record(campaign[:2], "first.mcap"), record(campaign[2:4], "second.mcap")]
    with pytest.raises(ConfigError, match=r"--group-by .*approach-angle"):
        evaluate(paths, Options(by_recording=True))


def test_flagged_run_is_named_with_its_own_recording(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate
) -> None:
    first = record(campaign[:6], "first.mcap")
    second = record([*campaign[6:11], BAD["swapped gauges"][0](campaign[11])], "second.mcap")
    found = analyse(first, second)
    label = found.result.runs[11].run.label
    assert f"negative_torque (1): trial 6 of second.mcap ({label}): " in texts(
        found.terminal_report()
    )
    assert f"Trial 6 of second.mcap, {label}: " in unescape(found.report())


def test_trial_is_checked_with_its_pre_trigger(
    campaign: Sequence[Recorded], record: Record
) -> None:
    sweep = open_sweep(record([before_the_trigger_removed(campaign[0])]))
    (reason,) = check_trial(sweep, sweep.trials[0])
    assert "before the relay command" in reason
    plan = replace(sweep.plan, constants={**sweep.plan.constants, "pre_trigger": 0.0})
    assert check_trial(replace(sweep, plan=plan), sweep.trials[0]) == []


def test_stated_uncertainty_without_use_is_named(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate
) -> None:
    path = record(campaign[:6])
    stated = {"wheel_radius": "50 mm +- 1 mm", "platform_mass": "3 kg +- 0.1 kg"}
    found = evaluate([path], corrections=Corrections(constants=stated))
    assert isinstance(found, CampaignEvaluation)
    assert "stated of wheel_radius, platform_mass enters no interval" in found.result.warnings[0]
    assert "stated of" not in " ".join(analyse(path).result.warnings)


def test_recordings_of_one_name_are_told_apart(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate, tmp_path: Path
) -> None:
    for day in ("monday", "tuesday"):
        (tmp_path / day).mkdir()
    good = record(campaign[:6], "monday/clean.mcap")
    spoilt = [BAD["swapped gauges"][0](item) for item in campaign[6:12]]
    bad = record(
        spoilt, "tuesday/clean.mcap", calibration=calibration_of(campaign[0].run, torque=2)
    )
    found = analyse(good, bad)
    used = [facts.entries["trials used"] for facts in found.provenance.facts[:2]]
    assert used == ["6", "0"]
    assert f"trial 1 of {bad} (" in texts(found.terminal_report())
    assert any(f"({good})" in line for line in found.calibrations_told)


def test_without_a_calibration_there_is_no_number(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate, tmp_path: Path
) -> None:
    path = record(campaign[:2], calibration=None)
    with pytest.raises(DataError, match="carries no calibration") as caught:
        analyse(path)
    assert "--calibration FILE" in str(caught.value.hint)
    other = tmp_path / "other.yaml"
    other.write_text(calibration_of(campaign[0].run))
    assert "the recording carries none" in analyse(path, calibration=other).calibrations_told[0]
    other.write_text(calibration_of(campaign[0].run).replace("rail_load", "rail_lode"))
    with pytest.raises(ConfigError, match="rail_lode"):
        analyse(path, calibration=other)


def test_a_calibration_that_lacks_a_value_is_refused(
    campaign: Sequence[Recorded], record: Record, analyse: Evaluate, calibration: str
) -> None:
    head, _, rest = calibration.partition("  rail_load:")
    short = head + rest[rest.index("  rail_viscous:") :]
    with pytest.raises(DataError, match="calibration bench has no rail_load"):
        analyse(record(campaign[:2], calibration=short))


def test_identify_prints_and_writes_campaign_results(
    campaign: Sequence[Recorded], record: Record
) -> None:
    path = record([*campaign[:5], BAD["swapped gauges"][0](campaign[5])])
    done = rigd("identify", path.name, cwd=path.parent)
    assert done.code == 0, done.err
    for words in ("clean_0", "0.1868", "5 used, 1 left out", "negative_torque (1)", "as recorded"):
        assert words in done.out
    page = (path.parent / "campaign.html").read_text()
    assert "campaign.html" in done.out
    assert "negative torque" in page
    told = rigd("identify", path.name, "--json", "--no-report", cwd=path.parent).json
    assert told["model"] == "approach-angle"
    assert told["sets"]["clean_0"]["paper"]["runs_flagged"] == 1
