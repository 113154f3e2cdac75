"""Several recordings of one condition: fitted together, compared, never counted twice."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from support.lugre.random_rigs import random_rig

from rigd.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation, complete_groups, groups
from rigd.analysis.recordings.source import open_sweep
from rigd.model.errors import DataError
from rigd.record import recover

FEW = "{from: 0.15 A, to: 1.5 A, step: 0.45 A}"  # the first does not move: nine of ten are used
Recorded = Callable[[str], Path]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Recordings of one rig: `before`, `again` with other noise, and `after` its floor changed."""
    folder = tmp_path_factory.mktemp("recorded")
    changed = {"after": {"mu_static": 0.2}}
    seeds = {"before": 1, "again": 2, "after": 3}

    @cache
    def made(name: str) -> Path:
        path = folder / f"{name}.mcap"
        (folder / name).mkdir()
        rig = random_rig(0, "pvc", folder / name, friction=changed.get(name), currents=FEW)
        rig.record(path, seed=seeds[name])
        return path

    return made


@cache
def fitted(*paths: Path, by_recording: bool = False) -> ParameterEvaluation:
    found = evaluate(paths, Options(starts=2, by_recording=by_recording))
    assert isinstance(found, ParameterEvaluation)
    return found


@pytest.mark.parametrize("names", [("before", "after"), ("after", "before")])
def test_unlike_recordings_are_reported_and_disagree(
    recorded: Recorded, names: tuple[str, str]
) -> None:
    found = fitted(*map(recorded, names))
    result = found.sections[0].result
    assert len({trial.label for trial in result.trials}) == len(result.trials) == 6
    test = next(item for item in result.residual_tests if item.name == "agreement of recordings")
    assert not test.passed
    assert any(test.sentence in warning for warning in result.warnings)
    assert "disagree" in str(found.terminal_report())
    json.dumps(found.to_json(), allow_nan=False)


def test_trend_is_over_time_in_either_order(recorded: Recorded) -> None:
    paths = [recorded("before"), recorded("after")]
    first, second = (
        next(item for item in found.sections[0].result.residual_tests if "steady" in item.name)
        for found in (fitted(*paths), fitted(*reversed(paths)))
    )
    assert "rises from trial to trial" in first.sentence
    assert second.sentence == first.sentence
    assert second.statistic == pytest.approx(first.statistic, rel=1e-3)


def test_trials_in_random_order_are_as_played(recorded: Recorded) -> None:
    sweep = open_sweep(recorded("before"))
    last = max(trial.start_ns for trial in sweep.trials)
    played = tuple(replace(trial, start_ns=2 * last - trial.start_ns) for trial in sweep.trials)
    found = groups([replace(sweep, info=replace(sweep.info, trials=played))])
    assert [trial.number for _, trial in found["pvc"]] == [4, 3, 2, 1]


def test_group_of_two_rigs_is_refused(recorded: Recorded) -> None:
    sweep = open_sweep(recorded("before"))
    other = replace(sweep, info=replace(sweep.info, rig="lugre-2"))
    with pytest.raises(DataError, match=r"is of the rig 'lugre-2', .* of the rig 'lugre-1'"):
        list(complete_groups([sweep, other], Options(), lambda _: None))
    assert len(list(complete_groups([sweep, sweep], Options(), lambda _: None))) == 1


def test_the_report_names_each_recording(recorded: Recorded) -> None:
    page = fitted(recorded("before"), recorded("after")).report()
    assert "before.mcap" in page
    assert "after.mcap" in page


def test_repeats_of_one_rig_agree(recorded: Recorded) -> None:
    result = fitted(recorded("before"), recorded("again")).sections[0].result
    test = next(item for item in result.residual_tests if item.name == "agreement of recordings")
    assert test.passed, test.sentence
    assert not any("disagree" in warning for warning in result.warnings)


def test_recordings_can_be_identified_each_by_itself(recorded: Recorded) -> None:
    paths = [recorded("before"), recorded("after")]
    found = fitted(*paths, by_recording=True)
    assert [section.label for section in found.sections] == [f"pvc, {path}" for path in paths]
    assert found.recordings == tuple((path,) for path in paths)


def test_only_trials_that_entered_the_fit_count(recorded: Recorded) -> None:
    """The one at 0.15 A barely moves, and is left out."""
    found = fitted(recorded("before"))
    facts = {fact.title: fact.entries for fact in found.provenance.facts}
    assert facts["before.mcap"]["trials used"] == "3"
    assert "3 of 4 trials used" in str(found.terminal_report())
    result = found.sections[0].result
    assert (len(result.trials), len(result.preprocessing.rejected)) == (3, 1)


def test_a_copy_beside_its_original_is_refused(recorded: Recorded, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    shutil.copyfile(recorded("before"), copy)
    with pytest.raises(DataError, match="sample for sample") as error:
        fitted(recorded("before"), copy)
    assert str(copy) in error.value.message
    assert str(recorded("before")) in error.value.message


def test_copy_of_which_part_is_left_is_refused(recorded: Recorded, tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    whole = recorded("before").read_bytes()
    torn.write_bytes(whole[: len(whole) * 3 // 4])
    recover(torn)
    with pytest.raises(DataError, match="sample for sample"):
        fitted(recorded("before"), torn)


def test_one_file_by_two_paths_is_refused(recorded: Recorded, tmp_path: Path) -> None:
    link = tmp_path / "link.mcap"
    link.symlink_to(recorded("before"))
    with pytest.raises(DataError, match=r"link\.mcap and .*before\.mcap"):
        fitted(recorded("before"), link)
    with pytest.raises(DataError, match=r"before\.mcap is given twice"):
        fitted(recorded("before"), recorded("before"))


def test_floor_that_cannot_answer_stops_no_other(recorded: Recorded, tmp_path: Path) -> None:
    few = tmp_path / "few.mcap"
    random_rig(0, "stone", tmp_path, currents="[0.9 A]").record(few, seed=1)
    found = fitted(recorded("before"), few)
    assert [section.label for section in found.sections] == ["pvc"]
    assert found.sections[0].result.parameter("sigma_0").identifiable
    assert not found.fits
    (refused,) = found.refused
    assert refused.sentence.startswith(f"stone ({few}): 1 of 1 trials can be fitted")
    assert f"not identified: {refused.sentence}" in str(found.terminal_report())
    saved = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert [group["group"] for group in saved["groups"]] == ["pvc"]
    assert saved["refused"][0]["recordings"] == [str(few)]
    assert refused.reason in found.report()


def test_refusal_of_all_floors_names_each(tmp_path: Path) -> None:
    few = [tmp_path / f"{floor}.mcap" for floor in ("stone", "pvc")]
    for path in few:
        random_rig(0, path.stem, tmp_path, currents="[0.9 A]").record(path, seed=1)
    with pytest.raises(DataError) as error:
        fitted(*few)
    assert all(f"{path.stem} ({path}): 1 of 1" in error.value.message for path in few)
