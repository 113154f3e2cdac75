"""What is wrong is named with file, line and column, and nothing is half imported."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.recordings.imported import MAP, Import

from rigd.importing import import_files, parse_map
from rigd.model import ConfigError, RecordingError

TABLE = "t,F,v\n" + "".join(f"{i / 1000},{i * 0.5},{i}\n" for i in range(20))

#: What is wrong, the file, options of the text, where it is reported, and with which words.
BAD = {
    "no such column": (TABLE.replace("F", "Q"), "{}", "map.yaml:9:23", "no column 'F'"),
    "time backward": (TABLE + "0.01,3,3\n", "{}", "old.csv:22:1", "runs backward by 0.009 s"),
    "time twice": (TABLE + "0.019,3,3\n", "{}", "old.csv:22:1", "same as in the row before"),
    "time jumps": (TABLE + "7.019,3,3\n", "{}", "old.csv:22:1", "jumps by 7 s within a trial"),
    "decimal point": ("t;F;v\n0,1;2;3\n0,2;3.5;4\n", "{decimal: ','}", "old.csv:3:5",
                      "'3.5' has a decimal '.', and the map says ','"),
    "decimal comma": ("t;F;v\n0.1;2;3\n0.2;3,5;4\n", "{}", "old.csv:3:5",
                      "'3,5' has a decimal ',', and the map says '.'"),
    "unit differs": (TABLE.replace("F", "F [kN]"), "{}", "old.csv:1:3", "states kN as the unit"),
    "nan as text": (TABLE + "0.02,NaN,3\n", "{}", "old.csv:22:6", "'NaN' is no number"),
    "word": (TABLE + "0.02,OVER,3\n", "{}", "old.csv:22:6", "'OVER' is no number"),
    "too large": (TABLE + "0.02,1e999,3\n", "{}", "old.csv:22:6", "'1e999' is too large"),
    "empty cell": (TABLE + "0.02,,3\n", "{}", "old.csv:22:6", "the cell is empty"),
    "missing time": (TABLE + "-,3,3\n", "{missing: '-'}", "old.csv:22:1", "a time is missing"),
    "empty file": ("", "{}", "old.csv:1:1", "the file is empty"),
    "names alone": ("t,F,v\n", "{}", "old.csv:1:1", "no data"),
    "cut off": (TABLE + "0.02,3,", "{}", "old.csv:22:8", "seems to be cut off"),
    "cut in a line": (TABLE + "0.02,3\n", "{}", "old.csv:22:7", "2 cells, expected 3"),
    "a cell more": (TABLE + "0.02,3,4,5\n", "{}", "old.csv:22:10", "4 cells, expected 3"),
    "blank line": (TABLE + "\n0.02,3,4\n", "{}", "old.csv:22:1", "the line is empty"),
    "other encoding": (TABLE.encode("utf-16"), "{}", "old.csv:1:1", "byte 0xff is no text"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_mistake_in_a_file_is_named(bring_in: Import, tmp_path: Path, case: str) -> None:
    text, options, place, words = BAD[case]
    with pytest.raises(ConfigError) as raised:
        bring_in(text, options)
    assert str(raised.value.place).endswith(place)
    assert words in raised.value.message
    assert not list((tmp_path / "runs").glob("*"))


def test_mistake_beyond_the_first_block_is_placed(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", 64)
    with pytest.raises(ConfigError) as raised:
        bring_in(TABLE + "0.01,3,3\n")
    assert str(raised.value.place).endswith("old.csv:22:1")


def test_one_bad_file_leaves_no_recordings(tmp_path: Path) -> None:
    for name, text in (("a", TABLE), ("b", TABLE + "1,x,2\n"), ("c", TABLE + "1,y,2\n")):
        (tmp_path / f"{name}.csv").write_text(text)
    with pytest.raises(ConfigError, match="'x' is no number") as raised:
        import_files(parse_map(MAP, Path("m.yaml")), sorted(tmp_path.glob("*.csv")), tmp_path / "o")
    assert [other.message for other in raised.value.others] == ["column 'F': 'y' is no number"]
    assert list((tmp_path / "o").iterdir()) == []


def test_existing_recording_is_kept(bring_in: Import, tmp_path: Path) -> None:
    before = bring_in(TABLE).path.read_bytes()
    with pytest.raises(RecordingError, match="exists already"):
        bring_in(TABLE.replace("0.5", "0.7"))
    assert (tmp_path / "runs/old.mcap").read_bytes() == before


SOURCES = (
    MAP.replace("    text", '    file: "{test}_samples.csv"\n    text')
    + """\
  motor:
    file: "{test}_motor.csv"
    time: {rate: 100 Hz}
    channels:
      current: {column: I, unit: A}
"""
)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a_samples.csv"], "has no file for the source motor, such as a_motor.csv"),
        (["a_samples.csv", "a_motor.csv", "notes.csv"], "notes.csv belongs to no source"),
        (["b/a_samples.csv", "gone.csv"], "there is no file"),
    ],
)
def test_files_that_make_no_test_are_named(tmp_path: Path, names: list[str], words: str) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        if name != "gone.csv":
            (tmp_path / name).write_text(TABLE)
    with pytest.raises(ConfigError) as raised:
        import_files(parse_map(SOURCES, Path("m.yaml")), [tmp_path / n for n in names], tmp_path)
    assert words in str(raised.value)


def test_two_files_of_one_source_are_refused(tmp_path: Path) -> None:
    map = MAP.replace("    text", '    file: "{test}_*.csv"\n    text')
    for name in ("a_force.csv", "a_speed.csv"):
        (tmp_path / name).write_text(TABLE)
    with pytest.raises(ConfigError, match="are both the source samples of the test"):
        import_files(parse_map(map, Path("m.yaml")), sorted(tmp_path.glob("*.csv")), tmp_path)


MAPS = {
    "unknown key": ("column: t,", "colum: t,", "map.yaml:7:12", "unknown key 'colum'"),
    "unknown unit": ("unit: N", "unit: Newton", "map.yaml:9:32", "unknown unit 'Newton'"),
    "comma twice": ("text: {}", "text: {separator: ',', decimal: ','}", "map.yaml:6:11", "comma"),
    "no time": ("{column: t, unit: s}", "{shift: 1 s}", "map.yaml:7:5", "the column of the times"),
    "time in N": ("unit: s", "unit: N", "map.yaml:7:29", "N is no unit of time"),
    "no unit": (", unit: N", "", "map.yaml:9:23", "states no unit of the column 'F'"),
    "zero of another kind": ("unit: N", "unit: V, zero: 1 N, scale: 2", "map.yaml:9:41",
                             "'1 N' is no quantity in V"),
    "unix times": ("unit: s", "unit: ns", "map.yaml:4:1", "would be of 20"),
    "group of a text": ("text: {}", "group: x", None, "a csv file has no group 'x'"),
    "no date": ("2016-03-04T10:00:00Z", "yesterday", "map.yaml:3:10", "no date and time"),
}  # fmt: skip


@pytest.mark.parametrize("case", MAPS)
def test_mistake_in_the_map_is_named(bring_in: Import, case: str) -> None:
    old, new, place, words = MAPS[case]
    with pytest.raises(ConfigError) as raised:
        text = "t,F,v\n1500000000000000000,1,2\n" if case == "unix times" else TABLE
        bring_in(text, map=MAP.replace(old, new))
    assert (str(raised.value.place), words in str(raised.value)) == (str(place), True)


PLANS = {
    "no such channel": ("signals: {wheel_angle: samples.angle}", "no channel 'samples.angle'"),
    "signal left out": ("signals: {wheel_angle: samples.force}", "needs the signal carriage_"),
}


@pytest.mark.parametrize("case", PLANS)
def test_plan_that_lacks_something_is_refused(bring_in: Import, case: str) -> None:
    plan, words = PLANS[case]
    with pytest.raises(ConfigError, match=words):
        bring_in(TABLE, more=f"identify:\n  model: lugre\n  {plan}\n")


def test_signal_of_another_kind_is_refused(bring_in: Import) -> None:
    signals = "{measured: samples.force, output: samples.force, relay: samples.speed}"
    bring_in(TABLE, more=f"identify:\n  model: relay\n  signals: {signals}\n", name="any.csv")
    wrong = ("{wheel_angle: samples.force, carriage_position: samples.force, "
             "acceleration: samples.force, motor_current: samples.force}")  # fmt: skip
    constants = "{mass: 1 kg, wheel_radius: 1 m, guide_friction: 1 N, rolling_resistance: 1, "
    more = (
        f"  constants: {constants} gravity: 9.81 m/s^2}}\nparameters: {{current: {{value: 1 A}}}}\n"
    )
    with pytest.raises(ConfigError, match=r"wheel_angle is samples\.force, in N") as raised:
        bring_in(TABLE, more=f"identify:\n  model: lugre\n  signals: {wrong}\n{more}")
    assert raised.value.place is not None
