"""``rigd compare``: measures of recordings, results of ``rigd identify``, groups that are wrong."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.text import Annotation

import rigd
from rigd.analysis.api import ResultOrigin
from rigd.analysis.compare import plots
from rigd.analysis.compare.campaign import files_of, grouped
from rigd.analysis.estimates import Estimate, Share
from rigd.analysis.plain_data import plain_object
from rigd.cli.main import main
from rigd.model.errors import ConfigError, DataError

Said = tuple[int, str, str]
Say = Callable[..., Said]


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str]) -> Say:
    """Return what the command with these arguments ends with and prints."""

    def compare(*arguments: object) -> Said:
        code = main(["compare", *map(str, arguments)])
        return code, *capsys.readouterr()

    return compare


def estimate(name: str, value: float, u: float, share: float = 0.0, group: str = "pvc") -> Estimate:
    """Return an estimate of relative standard uncertainty ``u``, and ``share`` of one constant."""
    reach = 1.959964 * (u**2 + share**2) ** 0.5
    shares = (Share("torque_constant", 0.03, 1e-4, share),) if share else ()
    return Estimate(
        group, name, "1/m", value, value * (1.0 - reach), value * (1.0 + reach), True,
        "identifiable", shares=shares, log=True,
    )  # fmt: skip


UNKNOWN = Estimate(
    "pvc", "V_s", "m/s", None, None, None, False, "not identifiable", "No slow slip."
)


def result(
    path: Path, *estimates: Estimate, rig: str = "lugre-1", day: str = "2026-09-01",
    method: str = "output error", model: str = "lugre", calibration: str = "",
    refused: Mapping[str, str] | None = None,
    constants: Mapping[str, tuple[float, float | None]] | None = None,
) -> Path:  # fmt: skip
    """Write a result as `rigd identify --json` does, with these estimates."""
    stated = {"name": calibration, "made": day} if calibration else {}
    origin = ResultOrigin(
        f"{path.stem}.mcap", rig, "p", model, f"{day}T08:00:00+00:00", stated, {}, constants or {}
    )
    told: dict[str, Any] = {
        "groups": [{"group": "pvc", "model": model, "method": method}],
        "origins": [asdict(origin)],
        "estimates": [plain_object(item) for item in estimates],
        "curves": [],
    }
    if refused is not None:
        told["refused"] = [{"group": group, "reason": why} for group, why in refused.items()]
    path.write_text(json.dumps(told))
    return path


def rows(out: str) -> dict[str, dict[str, Any]]:
    return {item["parameter"]: item for item in json.loads(out)["parameters"]}


def test_difference_and_no_difference_are_told_apart(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "before.json", estimate("sigma_0", 50.0, 0.005),
                   estimate("mu_c", 0.12, 0.004), UNKNOWN)  # fmt: skip
    second = result(tmp_path / "after.json", estimate("sigma_0", 52.5, 0.005),
                    estimate("mu_c", 0.1205, 0.004), UNKNOWN)  # fmt: skip
    code, out, _ = say(first, second)
    assert code == 0
    assert "sigma_0 (pvc) differs by +5.0 %, 3.6 … 6.5 %" in out
    assert "No difference found: mu_c (pvc)." in out
    assert "V_s (pvc): before: not identifiable; after: not identifiable" in out
    found = rows(say(first, second, "--json")[1])
    assert found["sigma_0"]["verdict"] == "differs"
    assert found["sigma_0"]["differences"]["after"]["low"] == pytest.approx(0.0356, abs=1e-4)
    assert found["V_s"]["differences"] == {}
    assert found["V_s"]["p_holm"] is None


def test_constant_that_both_state_cancels(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "before.json", estimate("sigma_0", 50.0, 0.004, share=0.03))
    second = result(tmp_path / "after.json", estimate("sigma_0", 52.5, 0.004, share=0.03))
    found = rows(say(first, second, "--json")[1])["sigma_0"]
    assert found["verdict"] == "differs"
    assert found["differences"]["after"]["cancelled"] > 0.9


def assuming(value: float, effect: float, left: float) -> Estimate:
    """Return a V_s whose interval rests on an exponent that the data leave open by ``left``."""
    share = Share("exponent of a law", 0.0, 0.05, effect, left)
    reach = math.exp(1.959964 * math.hypot(0.01, share.held))
    return replace(
        estimate("V_s", value, 0.01), low=value / reach, high=value * reach, shares=(share,)
    )


@pytest.mark.parametrize("left", [0.4, 0.8])
def test_assumption_cancels_and_is_told(say: Say, tmp_path: Path, left: float) -> None:
    """What each campaign knows of it differs by chance: the error itself is one."""
    first = result(tmp_path / "before.json", assuming(0.0044, 0.1, 0.6))
    second = result(tmp_path / "after.json", assuming(0.0048, 0.1, left))
    out = " ".join(say(first, second)[1].split())
    assert "V_s (pvc) differs by +9.1 %, 6.1 … 12.2 %" in out
    assert "if the exponent of a law is the same in all: if not, it need not differ." in out
    assert "The exponent of a law, which no file states (u = 0.05), counts as the same" in out
    found = rows(say(first, second, "--json")[1])["V_s"]
    assert (found["verdict"], found["rests_on"]) == ("differs", "exponent of a law")


def test_difference_beyond_assumption_rests_on_nothing(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "before.json", assuming(0.0044, 0.1, 0.6))
    second = result(tmp_path / "after.json", assuming(0.0088, 0.1, 0.6))
    assert "differs by +100.0 %" in (out := say(first, second)[1])
    assert "need not differ" not in out


def test_opposite_effects_of_assumption_add_up(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "before.json", assuming(0.0044, 0.1, 0.6))
    second = result(tmp_path / "after.json", assuming(0.0048, -0.1, 0.6))
    found = rows(say(first, second, "--json")[1])["V_s"]
    assert found["verdict"] == "none found"
    assert found["differences"]["after"]["high"] > math.expm1(2.0 * 0.12)


def test_constant_stated_otherwise_does_not_cancel(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "before.json", estimate("sigma_0", 50.0, 0.004, share=0.03))
    other = estimate("sigma_0", 52.5, 0.004, share=0.03)
    shares = (Share("torque_constant", 0.031, 1e-4, 0.03),)
    second = result(tmp_path / "after.json", Estimate(**{**vars(other), "shares": shares}))
    code, out, _ = say(first, second)
    assert code == 0
    assert "No difference found: sigma_0 (pvc)." in out
    assert "torque_constant is not stated alike (before: 0.03; after: 0.031)" in out


def test_same_value_of_another_uncertainty_is_named(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "before.json", estimate("sigma_0", 50.0, 0.004, share=0.03))
    other = estimate("sigma_0", 52.5, 0.004, share=0.03)
    shares = (Share("torque_constant", 0.03, 2e-4, 0.03),)
    second = result(tmp_path / "after.json", Estimate(**{**vars(other), "shares": shares}))
    _, out, _ = say(first, second)
    assert "torque_constant is stated with several uncertainties" in " ".join(out.split())


def test_constant_of_no_interval_is_compared_too(say: Say, tmp_path: Path) -> None:
    """An analysis that takes constants as exact: another value alone makes the difference."""
    first, second = (
        result(
            tmp_path / f"{name}.json", estimate("mu_c", mu, 0.004),
            constants={"wheel_radius": (radius, 1e-4), "gravity": (9.81, None)},
        )
        for name, mu, radius in (("before", 0.12, 0.05), ("after", 0.13, 0.0541))
    )  # fmt: skip
    _, out, _ = say(first, second)
    told = " ".join(out.split())
    assert "wheel_radius is not stated alike (before: 0.05; after: 0.0541)" in told
    assert "gravity" not in told
    assert "No interval here states which part of it comes from a constant." in told


def test_trend_over_months_names_calibrations(say: Say, tmp_path: Path) -> None:
    files = [
        result(tmp_path / f"m{k}.json", estimate("mu_c", 0.12 * 1.02**k, 0.002),
               day=f"2026-0{k}-15", calibration=f"scale-{k // 5}")
        for k in (3, 4, 5, 6)
    ]  # fmt: skip
    report = tmp_path / "year.html"
    code, out, _ = say(*files, "--report", report)
    assert code == 0
    told = "m6 1 recording, 2026-06-15, calibration scale-1 of 2026-06-15"
    assert told in " ".join(out.split())
    line = next(line for line in out.splitlines() if "a year" in line)
    assert "mu_c (pvc): +2" in line
    assert "scale-1 of 2026-06-15" in report.read_text("utf-8")


def test_open_side_is_drawn_as_arrow(tmp_path: Path) -> None:
    """Of four months the third leaves its upper end open; the first and last are closed."""
    files = []
    for k in range(1, 5):
        known = estimate("V_s", 0.004, 0.01)
        given = replace(known, high=None) if k == 3 else known
        files.append(result(tmp_path / f"m{k}.json", given, day=f"2026-0{k}-15"))
    found = rigd.compare(*files)
    campaigns = found.evaluation.comparison.campaigns
    (trend,) = plots.trend(found["V_s"], campaigns).axes
    low, high = trend.get_ylim()
    assert low < 0.004 * (1.0 - 0.0196) < 0.004 * 1.0196 < high
    (arrow,) = (item for item in trend.texts if isinstance(item, Annotation))
    assert arrow.xy[1] == pytest.approx(0.004)
    assert arrow.xyann == (arrow.xy[0], 1.0)
    (changes,) = plots.changes([("V_s", (0.1, -0.2, math.inf), False)]).axes
    lines = [np.asarray(item.get_xdata()).tolist() for item in changes.lines]
    assert [-20.0, 10.0] in [[round(x, 9) for x in line] for line in lines]
    (arrow,) = (item for item in changes.texts if isinstance(item, Annotation))
    assert arrow.xyann == (1.0, arrow.xy[1])
    page = found.report(tmp_path / "months.html").read_text("utf-8")
    assert "Arrow: the interval has no end on this side." in page


def test_open_low_end_is_no_hundred_percent(tmp_path: Path) -> None:
    known = estimate("V_s", 0.004, 0.01)
    first = result(tmp_path / "a.json", replace(known, high=None))
    found = rigd.compare(first, result(tmp_path / "b.json", known))
    assert found["V_s"].changes["b"][1] == -math.inf
    (row,) = rows(json.dumps(found.to_json())).values()
    assert row["differences"]["b"]["low"] is None


def test_groups_with_nothing_in_common_are_refused(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "a.json", estimate("mu_c", 0.1, 0.01))
    second = result(tmp_path / "b.json", estimate("mu_c", 0.1, 0.01, group="stone"))
    code, out, err = say(first, second)
    assert (code, out) == (7, "")
    assert "no trials of one kind in common (a: pvc; b: stone)" in err


@pytest.mark.parametrize(
    ("other", "says"),
    [
        ({"rig": "lugre-2"}, "were recorded on different rigs (a: lugre-1; b: lugre-2)"),
        ({"model": "robot"}, "identify different models (a: lugre; b: robot)"),
        ({"method": "slip-force"}, "pvc was identified in different ways"),
    ],
)
def test_groups_of_another_kind_are_refused(
    say: Say, tmp_path: Path, other: dict[str, Any], says: str
) -> None:
    first = result(tmp_path / "a.json", estimate("mu_c", 0.1, 0.01))
    code, out, err = say(first, result(tmp_path / "b.json", estimate("mu_c", 0.1, 0.01), **other))
    assert (code, out) == (7, "")
    assert says in err


def test_refused_group_has_reason_and_no_number(say: Say, tmp_path: Path) -> None:
    kept = estimate("mu_c", 0.1, 0.01, group="stone")
    first = result(tmp_path / "a.json", estimate("mu_c", 0.1, 0.01), kept)
    second = result(tmp_path / "b.json", kept, refused={"pvc": "no motion"})
    code, out, _ = say(first, second)
    assert code == 8
    assert "b: pvc: no motion" in out
    assert "mu_c (pvc): b: no such trials, or they were refused" in out
    assert rows(say(first, second, "--json")[1])["mu_c"]["differences"] is not None


def test_file_that_is_no_result_is_refused(say: Say, tmp_path: Path) -> None:
    first = result(tmp_path / "a.json", estimate("mu_c", 0.1, 0.01))
    for text, says in (("{", "cannot be read"), ('{"a": 1}', "is no result"), ("[]", "no result")):
        wrong = tmp_path / "wrong.json"
        wrong.write_text(text)
        code, out, err = say(first, wrong)
        assert (code, out) == (2, "")
        assert says in err and "wrong.json" in err


OPTIONS = [
    ("--set", "torque_constant=0.031"), ("--law", "static"), ("--method", "slip-force")
]  # fmt: skip


@pytest.mark.parametrize(("option", "value"), OPTIONS)
def test_options_are_refused_for_results(say: Say, tmp_path: Path, option: str, value: str) -> None:
    files = [result(tmp_path / f"{name}.json", estimate("mu_c", 0.1, 0.01)) for name in "ab"]
    code, out, err = say(*files, option, value)
    assert (code, out) == (2, "")
    assert f"{option} {value}: group a is a result, which is not identified again" in err
    assert "give the recordings" in err


def test_several_results_in_one_group_are_refused(say: Say, tmp_path: Path) -> None:
    for name in ("b1", "b2", "after"):
        result(tmp_path / f"{name}.json", estimate("mu_c", 0.1, 0.01))
    code, out, err = say(tmp_path / "b*.json", tmp_path / "after.json")
    assert (code, out) == (2, "")
    assert "b1.json and " in err and "b2.json are one group" in err
    assert "one result is a group by itself" in err
    with pytest.raises(ConfigError, match=r"b1.json and run.mcap are one group"):
        rigd.compare([tmp_path / "b1.json", "run.mcap"], tmp_path / "after.json")


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with measured breakaways: two seeds, of which the second has a batch."""
    folder = tmp_path_factory.mktemp("runs")
    for seed in (1, 2):
        rigd.run(
            "breakaway", rig="lugre-1", out=folder / f"b{seed}.mcap", seed=seed,
            meta={"batch": seed},
        )  # fmt: skip
    return folder


def test_measures_of_two_recordings_are_compared(say: Say, measured: Path) -> None:
    code, out, _ = say(measured / "b1.mcap", measured / "b2.mcap", "--json")
    assert code == 0
    found = json.loads(out)
    assert found["campaigns"][0]["model"] == "measures"
    subtracted = [row for row in found["parameters"] if row["differences"]]
    assert subtracted
    for row in subtracted:
        assert (row["test"], row["verdict"]) == (None, "not judged")
        assert row["why"].startswith("b1, b2: one run, which shows how trials differ")
        change = row["differences"]["b2"]
        assert change["low"] <= change["value"] <= change["high"]
        first, second = row["estimates"]["b1"], row["estimates"]["b2"]
        assert change["value"] == pytest.approx(second["value"] - first["value"])


@pytest.mark.parametrize(("option", "value"), OPTIONS)
def test_options_are_refused_for_measures(
    say: Say, measured: Path, option: str, value: str
) -> None:
    code, out, err = say(measured / "b1.mcap", measured / "b2.mcap", option, value)
    assert (code, out) == (2, "")
    assert f"{option} {value}: group b1 is compared by what its procedure measures" in err


def test_recordings_of_other_parameters_are_refused(
    say: Say, measured: Path, tmp_path: Path
) -> None:
    faster = tmp_path / "faster.mcap"
    rigd.run("breakaway", rig="lugre-1", out=faster, seed=3, set={"rate": "0.4 A/s"})
    code, out, err = say(measured, faster)
    assert (code, out) == (7, "")
    assert "no condition in common: rate is 0.2 A/s in " in err
    assert "0.4 A/s in faster" in err


def test_recordings_are_grouped_by_metadata(say: Say, measured: Path) -> None:
    code, out, _ = say(measured, "--by", "meta.batch", "--json")
    assert code == 0
    assert [item["name"] for item in json.loads(out)["campaigns"]] == ["1", "2"]
    code, _, err = say(measured, "--by", "meta.oven")
    assert code == 7 and "b1.mcap has no oven" in err
    code, _, err = say(measured, "--by", "moon")
    assert code == 2 and "by year, month, day" in err


def test_recordings_of_one_name_are_two_groups(measured: Path, tmp_path: Path) -> None:
    after = tmp_path / "after" / "b1.mcap"
    after.parent.mkdir()
    shutil.copy(measured / "b2.mcap", after)
    files = [measured / "b1.mcap", after]
    assert grouped(files, "recording") == {str(path): [path] for path in files}
    assert list(grouped([files[0], measured / "b2.mcap"], "recording")) == ["b1", "b2"]


def test_one_group_is_refused(say: Say, measured: Path) -> None:
    code, out, err = say(measured / "b1.mcap")
    assert (code, out) == (7, "")
    assert "one group has nothing to be compared with" in err


def test_same_file_in_both_groups_is_refused(say: Say, measured: Path, tmp_path: Path) -> None:
    first = measured / "b1.mcap"
    code, _, err = say(first, first)
    assert code == 7 and "is given twice" in err
    copy = tmp_path / "copy.mcap"
    shutil.copy(first, copy)
    code, _, err = say(first, copy)
    assert code == 7 and "is a copy of" in err


def test_groups_are_files_folders_or_patterns(measured: Path, tmp_path: Path) -> None:
    both = [measured / "b1.mcap", measured / "b2.mcap"]
    assert files_of(str(measured)) == both
    assert files_of(f"{measured}/*.mcap") == both
    assert files_of(str(both[0])) == both[:1]
    with pytest.raises(ConfigError, match="no file matches"):
        files_of(f"{measured}/*.mcapp")
    with pytest.raises(ConfigError, match="has no recording"):
        files_of(str(tmp_path))


def test_missing_recording_is_named(say: Say, measured: Path) -> None:
    code, out, err = say(measured / "b1.mcap", measured / "b9.mcap")
    assert (code, out) == (7, "")
    assert "b9.mcap" in err


def test_python_gives_the_object_of_the_command(say: Say, measured: Path) -> None:
    first, second = measured / "b1.mcap", rigd.open(measured / "b2.mcap")
    found = rigd.compare(first, [second])
    assert found.campaigns == ("b1", "b2")
    assert found.to_json() == json.loads(say(first, second.path, "--json")[1])
    assert rigd.compare(measured, by="meta.batch").campaigns == ("1", "2")


def test_python_gives_differences_as_table(tmp_path: Path) -> None:
    first = result(tmp_path / "a.json", estimate("sigma_0", 50.0, 0.005), UNKNOWN)
    second = result(tmp_path / "b.json", estimate("sigma_0", 52.5, 0.005), UNKNOWN)
    found = rigd.compare(first, second, names=("before", "after"))
    assert [item.name for item in found.different] == ["sigma_0"]
    value, low, high = found["sigma_0"].changes["after"]
    assert value == pytest.approx(0.05)
    assert 0.0 < low < value < high
    frame = found.to_pandas().set_index("parameter")
    assert frame.loc["sigma_0", "difference"] == value
    assert frame.loc["V_s", ["difference", "p_value"]].isna().all()
    assert frame.loc["V_s", "verdict"] == "not compared"
    assert "sigma_0 (pvc) differs by +5.0 %" in repr(found)
    assert "<td>+5.0 %</td>" in found._repr_html_()
    with pytest.raises(KeyError, match="no parameter 'sigma'"):
        found["sigma"]


def test_python_refuses_names_that_do_not_fit(tmp_path: Path) -> None:
    files = [result(tmp_path / f"{k}.json", estimate("mu_c", 0.1, 0.01)) for k in "ab"]
    for names in (("before",), ("same", "same")):
        with pytest.raises(ConfigError, match="2 groups have the names"):
            rigd.compare(*files, names=names)
    with pytest.raises(DataError, match="is given twice"):
        rigd.compare(files[0], files[0])
