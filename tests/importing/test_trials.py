"""Where trials begin and end, and which parameters they have."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.recordings.imported import MAP, Import

from rigd.importing import import_files, parse_map
from rigd.model import ConfigError
from rigd.record import Recording


def table(*rows: str) -> str:
    return "t,F,v,load,step\n" + "".join(f"{row}\n" for row in rows)


TWO = table(*(f"{i / 1000},{i},{i % 10},{5 if i < 20 else 10},{'up' if i % 20 < 5 else 'on'}"
              for i in range(40)))  # fmt: skip
BY_LOAD = """\
trials: {columns: load, steps: step}
parameters:
  load: {column: load, unit: kg}
  floor: {value: pvc}
"""


def spans(recording: Recording) -> list[tuple[int, int]]:
    start = recording.start_ns
    return [(t.start_ns - start, t.end_ns - start) for t in recording.trials]


def test_column_shows_trials_parameters_and_steps(bring_in: Import) -> None:
    recording = bring_in(TWO, more=BY_LOAD)
    assert spans(recording) == [(0, 19_000_001), (20_000_000, 39_000_001)]
    trials = recording.trials
    assert [t.parameters for t in trials] == [
        {"load": 5.0, "floor": "pvc"}, {"load": 10.0, "floor": "pvc"},
    ]  # fmt: skip
    assert trials[0].units == {"load": "kg"}
    assert trials[0].number == 5  # the column has whole numbers
    assert [step.name for step in trials[1].steps] == ["up", "on"]
    assert len(trials[1]["samples"]) == 20


def test_empty_cell_ends_the_step(bring_in: Import) -> None:
    names = ["", *["up"] * 9, *[""] * 20, *["on"] * 10]
    text = table(*(f"{i / 1000},{i},{i},5,{name}" for i, name in enumerate(names)))
    recording = bring_in(text, more="trials: {steps: step}\n")
    assert recording["samples"]["step"].tolist() == names
    assert [step.name for step in recording.steps] == ["up", "on"]


def test_texts_keep_the_plus_times_lose(bring_in: Import) -> None:
    text = table(*(f"+{i}000000,{i},{i},5,+{i // 20 + 1}" for i in range(40)))
    more = "trials: {columns: step}\nparameters: {side: {column: step}}\n"
    recording = bring_in(text, map=MAP.replace("unit: s}", "unit: ns}"), more=more)
    assert recording.read("samples")["t_ns"][1] == recording.start_ns + 1_000_000
    assert [trial.parameters["side"] for trial in recording.trials] == ["+1", "+2"]


def test_trials_are_the_same_in_small_blocks(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", 64)
    recording = bring_in(TWO, more=BY_LOAD)
    assert spans(recording) == [(0, 19_000_001), (20_000_000, 39_000_001)]
    assert [step.name for step in recording.trials[1].steps] == ["up", "on"]


def test_gap_shows_where_a_trial_ends(bring_in: Import) -> None:
    text = table(*(f"{i / 1000 + (i >= 20) * 2},{i},{i},5,on" for i in range(40)))
    recording = bring_in(text, more="trials: {gaps: 1 s}\n")
    assert spans(recording) == [(0, 19_000_001), (2_020_000_000, 2_039_000_001)]


def test_times_that_restart_follow_one_another(bring_in: Import) -> None:
    text = table(*(f"{i % 20 / 1000},{i},{i},5,on" for i in range(60)))
    map = MAP.replace("unit: s", "unit: s, restarts: true")
    recording = bring_in(text, map=map, more="trials: {gaps: 0.5 s}\n")
    assert spans(recording) == [
        (0, 19_000_001), (1_019_000_000, 1_038_000_001), (2_038_000_000, 2_057_000_001),
    ]  # fmt: skip


def test_signal_shows_when_a_trial_goes_on(bring_in: Import) -> None:
    text = table(*(f"{i / 1000},{i},{0 if i % 20 < 4 or i > 36 else 9},5,on" for i in range(40)))
    more = "trials: {signal: {channel: samples.speed, above: 1 mm/s}, shortest: 3 ms}\n"
    recording = bring_in(text, more=more)
    assert spans(recording) == [(4_000_000, 19_000_001), (24_000_000, 36_000_001)]
    assert [trial.complete for trial in recording.trials] == [True, True]


def test_trial_that_outlasts_file_is_incomplete(bring_in: Import) -> None:
    text = table(*(f"{i / 1000},{i},{0 if i < 4 else 9},5,on" for i in range(40)))
    more = "trials: {signal: {channel: samples.speed, above: 1 mm/s}}\n"
    (trial,) = bring_in(text, more=more).trials
    assert (trial.complete, trial.reason) == (False, "the file begins or ends within it")


@pytest.mark.parametrize(
    "trials",
    [
        "{signal: {channel: samples.speed, above: 1 mm/s}}",
        "{columns: step, outside: pause}",
    ],
)
@pytest.mark.parametrize("block_bytes", [64, 1 << 20])
def test_parameter_may_change_between_trials(
    bring_in: Import, trials: str, block_bytes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", block_bytes)
    goes_on = [i % 20 < 12 for i in range(40)]
    text = table(*(f"{i / 1000},{i},{9 if on else 0},{5 if i < 16 else 10},"
                   f"{i // 20 if on else ' pause'}" for i, on in enumerate(goes_on)))  # fmt: skip
    more = f"trials: {trials}\nparameters: {{load: {{column: load, unit: kg}}}}\n"
    recording = bring_in(text, more=more)
    assert [trial.parameters for trial in recording.trials] == [{"load": 5.0}, {"load": 10.0}]


def test_names_of_files_give_parameters(tmp_path: Path) -> None:
    map = MAP.replace("    text", '    file: "{floor}_{load}kg_{run}.csv"\n    text')
    more = "parameters: {floor: {name: floor}, load: {name: load, unit: kg}}\n"
    for name in ("pvc_0,5kg_1.csv", "pvc_2kg_1.csv"):
        (tmp_path / name).write_text(TWO)
    files = sorted(tmp_path.glob("*.csv"))
    made = import_files(parse_map(map + more, Path("m.yaml")), files, tmp_path / "runs")
    found = [Recording.open(item.path).trials[0].parameters for item in made]
    assert found == [{"floor": "pvc", "load": 0.5}, {"floor": "pvc", "load": 2.0}]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("trials: {columns: lod}\n", "no column 'lod'"),
        ("trials: {columns: load, gaps: 1 s}\n", "give one"),
        ("trials: {columns: load, outside: ['5', '10']}\n", "no trial was found"),
        ("parameters: {load: {column: load, unit: kg}}\n", "load changes within a trial"),
        ("trials: {columns: load}\nparameters: {step: {column: step}}\n", "changes within"),
        ("parameters: {load: {value: 5, column: load}}\n", "give its value, or the column"),
        ("parameters: {load: {name: load}}\n", "no `file` of the sources has {load}"),
        ("trials: {signal: {channel: samples.speed, above: 1 N}}\n", "'1 N' is no quantity in m/s"),
        ("trials: {gaps: 1 N}\n", "'1 N' is no quantity in s"),
        ("trials: {columns: F}\n", "is used as numbers and as text"),
    ],
)  # fmt: skip
def test_trials_that_cannot_be_are_refused(bring_in: Import, more: str, words: str) -> None:
    with pytest.raises(ConfigError) as raised:
        bring_in(TWO, more=more)
    assert words in str(raised.value)


#: Two trials whose masses stand in a table beside the samples.
TABLED = """\
trials: {columns: load, table: {file: trials.txt, key: number, text: {decimal: ","}}}
parameters: {mass: {column: mass, unit: kg}}
"""
PAIR = table(*(f"{i / 1000},{i},{i},{1 + i // 20},on" for i in range(40)))


def test_table_of_trials_may_repeat_a_row(bring_in: Import, tmp_path: Path) -> None:
    """The table of an exported recording has a row for each attempt at a trial."""
    (tmp_path / "trials.txt").write_text("number;mass\n1;4,2\n2;8,4\n2;8,4\n;\n;\n")
    found = [trial.parameters["mass"] for trial in bring_in(PAIR, more=TABLED).trials]
    assert found == [4.2, 8.4]


@pytest.mark.parametrize(
    ("rows", "place", "words"),
    [
        ("1;4,2\n2;8,4\n2;12,6\n", "trials.txt:4:1", "a second row '2', which differs"),
        ("1;4,2\n2;8.4\n", "trials.txt:3:3", "mass: '8.4' has a decimal '.', and the map says"),
        ("1;4,2\n2;much\n", "trials.txt:3:3", "mass: 'much' in column 'mass' is no number"),
    ],
)
def test_mistake_in_table_of_trials_is_placed(
    bring_in: Import, tmp_path: Path, rows: str, place: str, words: str
) -> None:
    (tmp_path / "trials.txt").write_text(f"number;mass\n{rows}")
    with pytest.raises(ConfigError) as raised:
        bring_in(PAIR, more=TABLED)
    assert str(raised.value.place).endswith(place)
    assert words in raised.value.message


@pytest.mark.parametrize(("decimal", "wrong"), [(",", "5.5"), (".", "5,5")])
def test_parameter_has_decimal_sign_of_map(bring_in: Import, decimal: str, wrong: str) -> None:
    right = wrong.replace(wrong[1], decimal)
    text = "t;F;v;load\n" + "".join(f"{i};1;1;{right if i < 9 else wrong}\n" for i in range(18))
    more = "trials: {columns: load}\nparameters: {load: {column: load, unit: kg}}\n"
    with pytest.raises(ConfigError) as raised:
        bring_in(text, f"{{separator: ';', decimal: '{decimal}'}}", more=more)
    assert str(raised.value.place).endswith("old.csv:11:7")
    assert f"load: {wrong!r} has a decimal {wrong[1]!r}" in raised.value.message
