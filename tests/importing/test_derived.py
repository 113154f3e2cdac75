"""Channels computed from old data: in a map, in a plan and in an export, equal to numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rigd
from rigd.analysis.measures import measured
from rigd.cli.main import main
from rigd.importing import import_files, parse_map
from rigd.model.errors import ConfigError
from rigd.procedure.loader import parse_procedure
from rigd.record import Recording

MAP = """\
map: pin
rig: tribometer
started: 2024-05-06T10:00:00Z
sources:
  pin:
    time: {column: t, unit: s}
    channels:
      fx: {column: Fx, unit: N}
      fz: {column: Fz, unit: N}
      v: {column: v, unit: m/s}
parameters:
  moved: {value: 0.4 kg}
"""
DERIVED = """\
derived:
  friction.mu: {is: friction.force / pin.fz, unit: 1}
  friction.force: {is: "pin.fx - ${moved} * derivative(pin.v)"}
"""
IDENTIFY = """\
identify:
  model: static-friction
  signals: {force: FORCE, speed: pin.v}
"""
PLAN = f"""\
procedure: evaluate
title: Evaluate
doc: Coefficient and force of friction of old data.
{DERIVED}measure:
  mu: {{mean: friction.mu}}
  most: {{max: friction.force}}
{IDENTIFY.replace("FORCE", "friction.force")}trial:
  steps: [{{step: none, for: 1 s}}]
"""


def logged() -> pd.DataFrame:
    """Return strokes both ways of a slider of 0.4 kg with 4 N + 6 N s/m of friction."""
    rng, count = np.random.default_rng(3), 8000
    t = np.arange(count) / 1000
    v = np.repeat([0.02, -0.05, 0.1, -0.2, 0.3, -0.5, 0.7, -0.9], 1000)
    v = v * np.clip(6.0 * np.sin(np.pi * (t % 1.0)), 0.0, 1.0)
    v = v + rng.normal(0.0, 1e-5, count)
    friction = np.sign(v) * (4.0 + 6.0 * np.abs(v)) + rng.normal(0.0, 0.05, count)
    # Each row knows the change since the row before, and the first one none.
    rate = np.concatenate([[0.0], np.diff(v) / (1e-9 * np.diff(np.rint(t * 1e9)))])
    return pd.DataFrame({
        "t": t, "Fx": friction + 0.4 * rate, "Fz": 20.0 + rng.normal(0.0, 0.1, count), "v": v,
        "own": (friction + 0.4 * rate) - 0.4 * rate,
    })  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("old")
    logged().to_csv(made / "old.csv", index=False)
    (made / "plan.yaml").write_text(PLAN)
    return made


def bring_in(folder: Path, name: str, more: str) -> Recording:
    what = parse_map(MAP + more, folder / f"{name}.yaml")
    (made,) = import_files(what, [folder / "old.csv"], folder / name)
    return Recording.open(made.path)


@pytest.fixture(scope="module")
def plain(folder: Path) -> Recording:
    return bring_in(folder, "plain", "")


def test_map_writes_channels_as_numpy_computes(folder: Path) -> None:
    recording = bring_in(folder, "derived", DERIVED)
    table = pd.read_csv(folder / "old.csv")
    rows = recording.read("friction")
    assert np.array_equal(rows["force"], table["own"])
    assert np.array_equal(rows["mu"], table["own"] / table["Fz"])
    assert Recording.open(recording.path, partial=True).complete
    assert recording.metadata["import"]["map"] == "derived.yaml"
    assert not list(recording.path.parent.glob(".*"))
    # The plan computes the same channels: those of the recording count.
    assert len(measured([recording], parse_procedure(PLAN, Path("plan.yaml"))).summaries) == 2


def test_plan_measures_channels_that_were_not_recorded(folder: Path, plain: Recording) -> None:
    result = measured([plain], parse_procedure(PLAN, folder / "plan.yaml"))
    table = pd.read_csv(folder / "old.csv")
    mu, most = (item.readings[0].value for item in result.summaries)
    assert mu == pytest.approx((table["own"] / table["Fz"]).mean(), rel=1e-12)
    assert most == table["own"].max()
    assert result.formulas["mu"] == {
        "friction.mu": "friction.force / pin.fz",
        "friction.force": "pin.fx - ${moved} * derivative(pin.v)",
    }


def test_plan_identifies_channels_that_were_not_recorded(folder: Path, plain: Recording) -> None:
    own = "      own: {column: own, unit: N}\n"
    what = MAP.replace("parameters:", own + "parameters:") + IDENTIFY.replace("FORCE", "pin.own")
    (made,) = import_files(parse_map(what, folder / "m.yaml"), [folder / "old.csv"], folder / "n")
    of_numpy = Recording.open(made.path)
    found, expected = rigd.identify(plain, plan=folder / "plan.yaml"), rigd.identify(of_numpy)
    assert found.to_json()["parameters"] == expected.to_json()["parameters"]
    coulomb = found["F_c"]
    assert coulomb.value == pytest.approx(4.0, abs=0.1)


def test_export_has_derived_channels(folder: Path, plain: Recording) -> None:
    target = folder / "tables"
    for number, file in enumerate(("plan.yaml", "alone.yaml")):
        (folder / "alone.yaml").write_text(DERIVED)
        arguments = [
            "--to",
            "csv",
            "--derived",
            str(folder / file),
            "--output",
            f"{target}{number}",
        ]
        assert main(["export", str(plain.path), *arguments]) == 0
        found = pd.read_csv(Path(f"{target}{number}") / "friction.csv")
        table = pd.read_csv(folder / "old.csv")
        assert np.array_equal(found["mu [1]"], table["own"] / table["Fz"])


@pytest.mark.parametrize(
    ("derived", "words"),
    [
        ("{pin.mu: {is: pin.fx / pin.fz}}", ["map.yaml:13:11", "there is a source pin already"]),
        ("{a.mu: {is: pin.fx / pin.fy}}", ["map.yaml:13:31", "'pin.fy'", "did you mean 'pin.f"]),
        ("{a.mu: {is: pin.fx + pin.v}}", ["map.yaml:13:31", "cannot add m/s and N"]),
        ("{a.x: {is: a.y}, a.y: {is: a.x}}", ["a channel cannot be computed from itself"]),
        ("{a.x: {is: '${mved} * pin.v'}}", ["unknown name '${mved}'", "did you mean 'moved'?"]),
    ],
)
def test_wrong_channel_of_map_is_named_with_line(
    folder: Path, tmp_path: Path, derived: str, words: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        what = parse_map(f"{MAP}derived: {derived}\n", Path("map.yaml"))
        import_files(what, [folder / "old.csv"], tmp_path)
    for text in words:
        assert text in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_recorded_channel_with_another_formula_is_refused(folder: Path) -> None:
    recording = bring_in(folder, "taken", DERIVED)
    other = PLAN.replace("friction.force / pin.fz", "pin.fx / pin.fz")
    with pytest.raises(ConfigError) as caught:
        measured([recording], parse_procedure(other, Path("plan.yaml")))
    text = str(caught.value)
    assert "plan.yaml:5:3" in text
    assert "has friction.mu already, as {is: friction.force / pin.fz, unit: 1}" in text
    assert "choose another name before the dot" in text


def test_rows_between_loggers_are_brought_together(folder: Path, tmp_path: Path) -> None:
    """Force at 2 kHz and speed at 1.5 kHz: the force lies on straight lines between its samples."""
    fast, slow = np.arange(4000) / 2000, np.arange(3000) / 1500
    pd.DataFrame({"t": fast, "F": 3.0 + 5.0 * fast}).to_csv(tmp_path / "a_force.csv", index=False)
    pd.DataFrame({"t": slow, "v": 0.1 + 0.2 * slow}).to_csv(tmp_path / "a_speed.csv", index=False)
    text = """\
map: two
rig: bench
started: 2024-05-06T10:00:00Z
sources:
  cell:
    file: "{test}_force.csv"
    time: {column: t, unit: s}
    channels: {f: {column: F, unit: N}}
  drive:
    file: "{test}_speed.csv"
    time: {column: t, unit: s}
    channels: {v: {column: v, unit: m/s}}
derived: {power.loss: {is: cell.f * drive.v, unit: W}}
"""
    files = [tmp_path / "a_force.csv", tmp_path / "a_speed.csv"]
    (made,) = import_files(parse_map(text, Path("two.yaml")), files, tmp_path / "runs")
    rows = Recording.open(made.path).read("power")
    assert len(rows) == 3000
    expected = (3.0 + 5.0 * slow) * (0.1 + 0.2 * slow)
    inside = slow <= fast[-1]
    np.testing.assert_allclose(rows["loss"][inside], expected[inside], rtol=1e-6)
