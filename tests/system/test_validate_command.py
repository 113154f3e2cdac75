"""A model is identified, and tried on recordings of another procedure."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from support.commands.command import rigd

PROCEDURES = Path(__file__).parents[2] / "procedures"
#: Of 24 trials, the lightest and the heaviest carriage with two currents.
FEW = "mass: [3.9593 kg, 1.9593 kg]\n    current: [0.6 A, 1.35 A]"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a model of PVC, and recordings of PVC and stone to try it on.

    ``models.json`` has it a second time, under the name of stone.
    """
    folder = tmp_path_factory.mktemp("lab")
    text = (PROCEDURES / "validation_masses.yaml").read_text()
    sweep = text[text.index("mass: [3.9593") : text.index("prepare:")]
    (folder / "few.yaml").write_text(text.replace(sweep, f"{FEW}\n\n"))
    text = (PROCEDURES / "constant_current.yaml").read_text()
    (folder / "some.yaml").write_text(text.replace("step: 0.15 A", "step: 0.45 A"))
    for procedure, floor in (("some", "pvc"), ("few", "pvc"), ("few", "stone")):
        record(folder, procedure, floor)
    done = rigd("identify", "some-pvc.mcap", "--json", "--no-report", cwd=folder)
    assert done.code == 0, done.err
    (folder / "pvc.json").write_text(done.out)
    other = {**done.json, "group": "stone", "conditions": {"floor": "stone"}}
    (folder / "models.json").write_text(json.dumps({"groups": [done.json, other]}))
    return folder


def record(folder: Path, procedure: str, floor: str) -> None:
    done = rigd(
        "run", f"{procedure}.yaml", "--rig", "lugre-1", "--set", f"floor={floor}",
        "--seed", "3" if procedure == "some" else "4", "--output", f"{procedure}-{floor}.mcap",
        cwd=folder,
    )  # fmt: skip
    assert done.code == 0, done.err


def validated(lab: Path, *arguments: str) -> tuple[int, Any]:
    done = rigd("validate", *arguments, "--json", "--no-report", cwd=lab)
    return done.code, done.json


def test_each_floor_is_tried_by_its_own_model(lab: Path) -> None:
    record(lab, "some", "stone")
    done = rigd("identify", "some-stone.mcap", "some-pvc.mcap", "--json", "--no-report", cwd=lab)
    assert done.code == 0, done.err
    (lab / "floors.json").write_text(done.out)
    code, found = validated(lab, "floors.json", "few-stone.mcap", "few-pvc.mcap")
    assert code == 0
    assert found["published"] == "Table II of the paper"
    assert [group["outcome"] for group in found["groups"]] == ["confirmed", "confirmed"]
    assert [group["model"] for group in found["groups"]] == [
        "stone of floors.json", "pvc of floors.json",
    ]  # fmt: skip
    for group in found["groups"]:
        assert len(group["trials"]) == 4
        for trial in group["trials"]:
            assert trial["deviations"]["slip"]["rms"] < 0.002
            assert trial["deviations"]["speed"]["rms"] < 0.005
            assert trial["deviations"]["speed"]["published"] > 0.005
            assert trial["conditions"].keys() == {"floor", "mass", "current"}


def test_wrong_floor_is_rejected_with_its_code(lab: Path) -> None:
    code, found = validated(lab, "models.json", "few-stone.mcap", "--group", "pvc")
    assert code == 8
    (group,) = found["groups"]
    assert group["outcome"] == "rejected"
    assert group["model"] == "pvc of models.json"
    assert "The model is of floor pvc, the trials are of stone." in group["findings"]


def test_constant_that_is_off_is_named_and_corrected(lab: Path) -> None:
    wrong = "torque_constant=30.09 mN m/A"
    code, found = validated(lab, "pvc.json", "few-pvc.mcap", "--set", wrong)
    assert code == 0
    (group,) = found["groups"]
    assert group["outcome"] == "confirmed with another constant"
    (bias,) = group["biases"]
    assert bias["name"] == "torque_constant"
    assert bias["value"] == pytest.approx(0.0295, rel=3e-3)
    assert found["corrected"][0]["what"] == "torque_constant"


def test_terminal_and_page_show_verdict_and_tables(lab: Path) -> None:
    done = rigd("validate", "pvc.json", "few-pvc.mcap", cwd=lab)
    assert done.code == 0, done.err
    page = (lab / "few-pvc-validation.html").read_text()
    for words in ("confirmed", "Table II of the paper", "mass 3.9593 kg, current 0.6 A", "slip"):
        assert words in done.out
        assert words in page
    assert done.out.startswith("Usable: pvc of pvc.json on pvc, confirmed by 4 trials.")
    assert "few-pvc-validation.html" in done.out
    assert "http" not in page.replace("http://www.w3.org", "")


def test_own_recording_is_no_prediction(lab: Path) -> None:
    code, found = validated(lab, "pvc.json", "some-pvc.mcap")
    assert code == 0
    assert any("no prediction" in text for text in found["groups"][0]["findings"])


def test_copy_of_own_recording_is_no_prediction(lab: Path, tmp_path: Path) -> None:
    shutil.copyfile(lab / "some-pvc.mcap", tmp_path / "copy.mcap")
    code, found = validated(tmp_path, str(lab / "pvc.json"), "copy.mcap")
    assert code == 0
    assert any("no prediction" in text for text in found["groups"][0]["findings"])


def test_model_of_another_rig_is_named(lab: Path) -> None:
    code, found = validated(lab, edited(lab, lambda d: d.update(rigs=["lugre-2"])), "few-pvc.mcap")
    assert code == 0
    sentence = "The model is of the rig lugre-2, the trials are of lugre-1."
    assert sentence in found["groups"][0]["findings"]


def edited(lab: Path, change: Any) -> str:
    data = json.loads((lab / "pvc.json").read_text())
    change(data)
    (lab / "edited.json").write_text(json.dumps(data, indent=1))
    return "edited.json"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(model="unknown"), "few-pvc.mcap identifies lugre, edited.json"),
        (lambda d: d.update(model="lugre-4"), "these are parameters of the friction law lugre-4"),
        (
            lambda d: (d["fit"].pop("point"), d["parameters"]["V_s"].update(estimate=None)),
            "the model has no value of V_s",
        ),
        (
            lambda d: d["parameters"]["sigma_0"].update(unit="1/mm"),
            "parameters.sigma_0 is in 1/mm, must be in 1/m",
        ),
        (lambda d: d["fit"]["point"]["values"].__setitem__(3, -1.0), "sigma_0 is -1 1/m, must be"),
        (lambda d: d["fit"]["point"].update(values=[1.0]), "must be 6 numbers"),
        (lambda d: d["fit"]["point"].update(units=["1"] * 6), "fit.point.units must be m/s"),
        (lambda d: d["fit"]["point"].update(names=["a"] * 6), "fit.point.names must be V_s"),
        (
            lambda d: d["fit"]["point"]["covariance"][0].__setitem__(0, -1.0),
            "is no covariance",
        ),
        (lambda d: d.update(gate={"outcome": "does not fit"}), "did not fit the recordings"),
    ],
)  # fmt: skip
def test_bad_model_is_refused_in_a_sentence(change: Any, words: str, lab: Path) -> None:
    done = rigd("validate", edited(lab, change), "few-pvc.mcap", cwd=lab)
    assert done.code in (2, 7)
    assert words in done.err
    assert len(done.err.splitlines()) <= 4, done.err
    if done.code == 2:
        assert "edited.json:" in done.err  # with line and column


def test_model_typed_from_a_paper_is_tried(lab: Path) -> None:
    table_1 = {
        "V_s": (1.9643, "m/s"), "mu_c": (0.12, "1"), "mu_s": (0.1205, "1"),
        "sigma_0": (11.451, "1/m"), "sigma_1": (0.0809, "s/m"), "sigma_2": (2.4490, "s/m"),
    }  # fmt: skip
    parameters = {name: {"estimate": x, "unit": unit} for name, (x, unit) in table_1.items()}
    (lab / "typed.json").write_text(json.dumps({"model": "lugre", "parameters": parameters}))
    code, found = validated(lab, "typed.json", "few-stone.mcap")
    assert code == 0
    assert any("no uncertainty" in text for text in found["groups"][0]["findings"])


def test_recording_of_another_rig_is_refused(lab: Path) -> None:
    done = rigd("run", "calibrate_scale", "--rig", "angle-1", "--output", "scale.mcap", cwd=lab)
    assert done.code == 0, done.err
    done = rigd("validate", "pvc.json", "scale.mcap", cwd=lab)
    assert done.code == 7
    assert "scale.mcap identifies scale-calibration, pvc.json is a model of lugre" in done.err


def test_recording_without_the_drive_is_refused(lab: Path) -> None:
    text = (lab / "few.yaml").read_text()
    lines = [line for line in text.splitlines() if "torque_constant" not in line]
    (lab / "bare.yaml").write_text("\n".join(lines))
    done = rigd("run", "bare.yaml", "--rig", "lugre-1", "--output", "bare.mcap", cwd=lab)
    assert done.code == 0, done.err
    done = rigd("validate", "pvc.json", "bare.mcap", cwd=lab)
    assert done.code == 7
    assert "needs torque_constant" in done.err
    assert "--set" in done.err


def test_report_never_overwrites_recording(lab: Path) -> None:
    done = rigd("validate", "pvc.json", "few-pvc.mcap", "--report", "some-pvc.mcap", cwd=lab)
    assert done.code == 2
    assert "would overwrite a recording" in done.err
