"""What a lab demands of a run, and what a specimen's file states."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.lab.lab import load_lab, load_specimen, stated_specimen
from rigd.model.about import About
from rigd.model.errors import ConfigError

LAB = """\
lab: tribology
fields:
  operator: {required: true}
  specimen: {required: true}
  meta.batch: {required: true, kind: number, min: 1, doc: Batch of the supplier}
  meta.humidity: {unit: "%", min: 20 %, max: 80 %}
  meta.cleaned: {kind: date}
  specimen.coating: {required: true, choices: [PTFE, DLC]}
  specimen.size.diameter: {unit: mm, max: 50 mm}
"""
W7 = """\
specimen: W7
coating: PTFE
hardness: 5 GPa
size: {diameter: 2 cm, height: 0.80 cm}
"""
META = {"batch": "13", "humidity": "0.41", "cleaned": "2026-11-27"}


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    (tmp_path / "specimens").mkdir()
    (tmp_path / "specimens" / "W7.yaml").write_text(W7)
    (tmp_path / "lab.yaml").write_text(LAB)
    return tmp_path / "lab.yaml"


def test_a_specimen_is_read_as_it_is_written(lab: Path) -> None:
    found = stated_specimen(About("A", "", META, "W7"), lab)
    assert (found.name, found.text) == ("W7", W7)
    assert found.fields == {
        "coating": "PTFE", "hardness": "5 GPa", "size.diameter": "2 cm", "size.height": "0.80 cm",
    }  # fmt: skip


def test_without_a_lab_nothing_is_demanded(
    tmp_path: Path, lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert stated_specimen(About(), None).name == ""
    monkeypatch.chdir(tmp_path)
    assert stated_specimen(About(specimen="W7"), None).fields["coating"] == "PTFE"
    assert stated_specimen(About(specimen="W8"), None).fields == {}


def test_all_that_is_missing_is_named_at_once(lab: Path) -> None:
    with pytest.raises(ConfigError) as raised:
        stated_specimen(About(), lab)
    text = str(raised.value)
    assert f"{lab}:3:3: the lab tribology demands operator of each run" in text
    assert "give --operator NAME" in text
    assert "give --specimen NAME" in text
    assert "it is missing: Batch of the supplier" in text
    assert "give --meta batch=" in text
    assert "coating" not in text  # there is no specimen to have one
    with pytest.raises(ConfigError, match=r"demands specimen\.coating of each run") as raised:
        stated_specimen(About("A", "", META, "W8"), lab)
    assert "write 'coating: PTFE' into" in str(raised.value)


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        ({"batch": "many"}, "meta.batch: 'many' is not a number"),
        ({"batch": "13 kg"}, "'13 kg' is not a number without a unit"),
        ({"batch": "0"}, "'0' is less than 1"),
        ({"humidity": "41 degC"}, "'41 degC' is not in %"),
        ({"humidity": "90 %"}, "'90 %' is more than 80 %"),
        ({"cleaned": "yesterday"}, "is not a date such as 2026-09-01"),
    ],
)
def test_a_value_of_another_kind_is_refused(lab: Path, meta: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        stated_specimen(About("A", "", {**META, **meta}, "W7"), lab)
    assert message in str(raised.value)


def test_value_rounded_beyond_bound_is_taken(lab: Path) -> None:
    lab.write_text(LAB.replace("max: 50 mm", "max: 0.57 m"))
    (lab.parent / "specimens" / "W7.yaml").write_text(W7.replace("2 cm", "570 mm"))
    assert stated_specimen(About("A", "", META, "W7"), lab).fields["size.diameter"] == "570 mm"


def test_values_of_a_specimen_are_checked(lab: Path) -> None:
    file = lab.parent / "specimens" / "W7.yaml"
    file.write_text(W7.replace("PTFE", "none").replace("2 cm", "2 m"))
    with pytest.raises(ConfigError) as raised:
        stated_specimen(About("A", "", META, "W7"), lab)
    assert f"specimen.coating in {file}: 'none' is not one of PTFE, DLC" in str(raised.value)
    assert "'2 m' is more than 50 mm" in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("specimen: W7", "specimen: W8", "W7.yaml:1:11: this is specimen 'W8'"),
        ("specimen: W7", "name: W7", "the name of the specimen is missing"),
        ("PTFE", "[PTFE, DLC]", "W7.yaml:2:10: coating is a list"),
        ("coating: PTFE", "coating:", "W7.yaml:2:"),
        ("coating", "2nd", "W7.yaml:2:1: '2nd' is not a name"),
    ],
)
def test_a_wrong_specimen_is_shown_where(lab: Path, old: str, new: str, message: str) -> None:
    file = lab.parent / "specimens" / "W7.yaml"
    file.write_text(W7.replace(old, new))
    with pytest.raises(ConfigError) as raised:
        load_specimen("W7", file.parent)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("meta.batch", "batch", "lab.yaml:5:3: "),
        ("kind: date", "kind: dates", "lab.yaml:7:24: "),
        ("max: 50 mm", "max: 50 kg", "max is 50 kg, and the unit is mm"),
        ("unit: mm", "unit: inch", "unknown unit 'inch'"),
        ("{kind: date}", "{kind: date, unit: s}", "a date has no unit"),
        ("{kind: date}", "{min: 5}", "min bounds a quantity"),
        ("required: true, kind", "needed: true, kind", "needed"),
    ],
)
def test_a_wrong_lab_is_shown_where(lab: Path, old: str, new: str, message: str) -> None:
    lab.write_text(LAB.replace(old, new))
    with pytest.raises(ConfigError) as raised:
        load_lab(lab)
    assert message in str(raised.value)
