"""``rigd check``: what is right, what is wrong, and what is for another rig."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from rigd.cli.main import main
from rigd.remote.tls import setup_tls
from rigd.sdk.shipped_files import shipped_folder

PROCEDURES = shipped_folder("procedures")
ALL = sorted(str(file) for file in PROCEDURES.glob("*.yaml"))
QUICK = str(PROCEDURES / "quick.yaml")
ANGLES = str(PROCEDURES / "approach_angles.yaml")


def check(*words: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = main(["check", *words])
    told = capsys.readouterr()
    return code, told.out, told.err


#: The devices that the procedures of each rig name.
DEVICES = {
    "lugre-1": {
        "accelerometer", "carriage", "lateral_belt", "longitudinal_belt", "wheel_encoder",
        "wheel_servo",
    },
    "angle-1": {"daq", "relay", "scale"},
    "articulated-1": {"front_marker", "left_motor", "rear_marker", "right_motor"},
    "articulated-3": {
        *("first_left", "first_right", "last_left", "last_right"),
        *("marker_first", "marker_last", "marker_middle"),
    },
    "tribometer-1": {"contact", "spindle"},
}  # fmt: skip


@pytest.mark.parametrize("rig", DEVICES)
def test_procedure_for_another_rig_takes_a_line(
    rig: str, capsys: pytest.CaptureFixture[str]
) -> None:
    lacked = set().union(*DEVICES.values()) - DEVICES[rig]
    if rig == "angle-1":
        lacked.add("daq.normal_force_raw")  # of the rig with the fast load cell
    missing = ", ".join(sorted(lacked))
    code, out, err = check(*ALL, "--rig", rig, capsys=capsys)
    assert (code, err) == (0, "")
    *lines, summary = [line for line in out.splitlines() if not line.startswith("  ")]
    assert [line.partition(":")[0] for line in lines] == ALL
    others = [line for line in lines if f": for another rig: {rig} has no " in line]
    fits = [line for line in lines if line.endswith(f" on {rig}: right")]
    assert len(others) + len(fits) == len(ALL)
    assert summary == f"{len(fits)} right, {len(others)} for another rig (no {missing})"


@pytest.mark.parametrize("files", [[ANGLES], [ANGLES, "lugre-1"]], ids=["alone", "no other"])
def test_procedure_for_another_rig_fails_if_none_fits(
    files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = check(*files, "--rig", "lugre-1", capsys=capsys)
    assert code == 2
    assert f"{ANGLES}: for another rig: lugre-1 has no daq, relay, scale" in err


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("wheel_servo.current", "wheel_serov.current", "no setpoint 'wheel_serov.current'"),
        ("wheel_servo.current", "wheel_servo.curent", "no setpoint 'wheel_servo.curent'"),
        ("title:", "titel:", "unknown key 'titel'"),
    ],
)
def test_mistake_is_not_counted_as_other_rig(
    old: str, new: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    text = Path(QUICK).read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new), "utf-8")
    code, out, err = check(QUICK, str(file), ANGLES, "--rig", "lugre-1", capsys=capsys)
    assert code == 2
    assert told in err
    assert out.splitlines()[-1] == "1 right, 1 for another rig (no daq, relay, scale), 1 wrong"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("changes: floor", "changes: flour", "the plant of lugre-1 has no 'flour'"),
        ("answer: ${floor}", "answer: carpet", "it takes stone, pvc, paperboard"),
    ],
)
def test_unknown_setting_of_the_plant_is_refused(
    old: str, new: str, problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    text = (PROCEDURES / "constant_current.yaml").read_text("utf-8")
    assert text.count(old) == 1
    text = text.replace(old, new).replace('choices: ["${floor}"]', "free_text: true")
    file.write_text(text, "utf-8")
    line = text[: text.index(new)].count("\n") + 1
    code, _, err = check(QUICK, str(file), "--rig", "lugre-1", capsys=capsys)
    assert code == 2
    assert f"{file}:{line}:" in err
    assert problem in err


def test_a_mistake_beside_missing_devices_shows_all_problems(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    text = Path(ANGLES).read_text("utf-8")
    assert "timeout: 20 s" in text
    file.write_text(text.replace("timeout: 20 s", "timeout: 20 A", 1), "utf-8")
    code, _, err = check(QUICK, str(file), "--rig", "lugre-1", capsys=capsys)
    assert code == 2
    assert "'20 A' is in A, expected s" in err
    assert "no setpoint 'relay.closed'" in err


def test_run_on_another_rig_names_missing_devices(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", ANGLES, "--rig", "lugre-1", "--dry-run"]) == 2
    first, *hint = capsys.readouterr().err.splitlines()
    assert re.search(r":\d+:\d+: .* for another rig: lugre-1 has no daq, relay, scale$", first)
    assert len(hint) == 1


def test_json_names_the_devices_that_are_missing(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = check(QUICK, ANGLES, "--rig", "lugre-1", "--json", capsys=capsys)
    assert code == 0
    fits, other = json.loads(out)
    assert fits["right"] is True
    assert (other["right"], other["missing_devices"]) == (False, ["daq", "relay", "scale"])


@pytest.mark.parametrize(
    ("file", "key"),
    [("sim_lugre.yaml", "rig"), ("calibrations/approach_angle.yaml", "calibration")],
)
def test_file_without_first_line_is_judged_by_others(
    file: str, key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (shipped_folder("configs") / file).read_text("utf-8").splitlines(keepends=True)
    kept = [line for line in lines if not line.startswith(f"{key}:")]
    assert len(kept) == len(lines) - 1
    spoilt = tmp_path / "spoilt.yaml"
    spoilt.write_text("".join(kept), "utf-8")
    code, _, err = check(str(spoilt), capsys=capsys)
    assert code == 2
    assert f"key {key!r} is missing" in err
    assert "unknown key" not in err


def test_folder_as_rig_is_reported_as_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"{tmp_path} is a folder" in said
    assert f"{tmp_path}/*.yaml" in said
    assert "did you mean" not in said


def test_check_of_real_rig_checks_its_sibling(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "wire-1"]) == 0
    assert "sibling lugre-1 (" in capsys.readouterr().out
    text = (shipped_folder("configs") / "wire_lugre.yaml").read_text()
    (tmp_path / "real.yaml").write_text(text.replace("sim_lugre.yaml", "sim.yaml"))
    assert main(["check", str(tmp_path / "real.yaml")]) == 2
    assert "real.yaml:17:10: the sibling" in capsys.readouterr().err


def test_what_sibling_lacks_of_procedure_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "quick.yaml"
    text = (PROCEDURES / "quick.yaml").read_text()
    bound = "trial:\n  limits: {traction.force: {high: 100 N}}\n"
    for written, named in ((text.replace("trial:\n", bound, 1), True), (text, False)):
        own.write_text(written)
        code, out, _ = check(str(own), "--rig", "wire-1", capsys=capsys)
        assert code == 0
        said = "no dry run on the sibling lugre-1: procedure quick uses traction.force" in out
        assert said == named


def test_setpoint_that_interlock_cannot_see_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = check(str(PROCEDURES / "constant_current.yaml"), "--rig", "lugre-1",
                         capsys=capsys)  # fmt: skip
    assert code == 0
    assert "wheel_servo.current is 0.15 A there, within its band of 0.2 A" in out


def test_constant_that_procedure_leaves_out_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (shipped_folder("configs") / "sim_lugre.yaml").read_text("utf-8")
    assert text.count("\nconstants:\n") == 1
    weighed = "\nconstants:\n  guide_lift: {value: 0.3 N, u: 0.02 N}\n"
    rig = tmp_path / "mine.yaml"
    rig.write_text(text.replace("\nconstants:\n", weighed), "utf-8")
    code, out, _ = check("constant_current", "--rig", str(rig), capsys=capsys)
    assert code == 0
    assert "the rig states guide_lift, which model lugre takes: give it as" in out
    _, out, _ = check("constant_current", "--rig", "lugre-1", capsys=capsys)
    assert "guide_lift" not in out


def test_derived_channels_count_as_no_device(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (shipped_folder("configs") / "sim_lugre.yaml").read_text("utf-8")
    more = "derived: {half.angle: {is: wheel_encoder.angle / 2}}\ninterlocks:\n"
    counts = set()
    for name, written in (("plain", text), ("more", text.replace("interlocks:\n", more, 1))):
        (tmp_path / f"{name}.yaml").write_text(written, "utf-8")
        _, out, _ = check(str(tmp_path / f"{name}.yaml"), capsys=capsys)
        counts.add(re.findall(r"\d+ devices", out)[0])
    assert len(counts) == 1


def test_shipped_rig_is_found_by_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert check("configs/wire_lugre.yaml", capsys=capsys)[0] == 0
    code, _, err = check("wire_lugre.yaml", capsys=capsys)
    assert code == 2
    assert "to use the shipped rig, give its name: wire_lugre" in err
    assert "calibrate_rise" not in check("configs/wire_lugr.yaml", capsys=capsys)[2]


def test_rig_whose_lab_is_missing_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (shipped_folder("configs") / "sim_lugre.yaml").read_text()
    (tmp_path / "rig.yaml").write_text(text + "\nlab: nolab.yaml\n")
    code, _, err = check(str(tmp_path / "rig.yaml"), capsys=capsys)
    assert code == 2
    assert "nolab.yaml" in err


def test_certificates_of_rig_are_opened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (shipped_folder("configs") / "sim_lugre.yaml").read_text("utf-8")
    tls = "  tls: {ca: ca.crt, certificate: rigd.crt, key: rigd.key}\n"
    tls = f"remote:\n  listen: [tls/0.0.0.0:7447]\n{tls}"
    rig = tmp_path / "mine.yaml"
    rig.write_text(f"{text}{tls}  roles: {{alice: operator}}\n", "utf-8")
    code, out, _ = check(str(rig), capsys=capsys)
    assert code == 0
    assert "ca.crt does not exist yet: `rigd remote setup-tls` makes certificates" in out
    setup_tls(tmp_path, ["rig.lab"], [])
    assert check(str(rig), capsys=capsys)[0] == 0
    (tmp_path / "rigd.crt").write_text("root:*:19000:0:99999:7:::\n")
    code, _, err = check(str(rig), capsys=capsys)
    assert code == 2
    assert "rigd.crt is no certificate in PEM" in err
    assert "root" not in err.replace(str(tmp_path), "")


def test_wrong_plant_file_makes_a_procedure_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    configs = shipped_folder("configs")
    plant = (configs / "plants" / "lugre.yaml").read_text("utf-8")
    (tmp_path / "mine.yaml").write_text(plant.replace("radius: 50 mm", "radius: 50 kg", 1))
    rig = (configs / "sim_lugre.yaml").read_text("utf-8")
    (tmp_path / "rig.yaml").write_text(rig.replace("plants/lugre.yaml", "mine.yaml"))
    code, _, err = check(QUICK, "--rig", str(tmp_path / "rig.yaml"), capsys=capsys)
    assert code == 2
    assert "mine.yaml:" in err
    assert "50 kg" in err
