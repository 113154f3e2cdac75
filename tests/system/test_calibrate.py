"""`rigd calibrate` as a user meets it: measured, shown, written; and what a run asks of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.commands.command import Ended, rigd
from support.commands.terminal import Terminal

from rigd.config.calibration.calibration import load_calibration, parse_calibration
from rigd.record import Recording
from rigd.sdk.shipped_files import shipped_folder

CONFIGS = shipped_folder("configs")
FILE = Path("calibrations/approach_angle.yaml")
SHIPPED = CONFIGS / FILE
CAMPAIGN = ("run", "approach_angles", "--set", "set=clean_0", "--set", "load=4 kg")
OPERATOR = ("--operator", "A. Miller")


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """Return a folder with a rig file of one's own and its calibration beside it."""
    text = (CONFIGS / "sim_approach_angle.yaml").read_text()
    (tmp_path / "bench.yaml").write_text(text)
    (tmp_path / FILE).parent.mkdir()
    (tmp_path / FILE).write_text(SHIPPED.read_text())
    return tmp_path


@pytest.fixture(scope="module")
def torque(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recording of a calibration of torque on the shipped rig."""
    folder = tmp_path_factory.mktemp("torque")
    done = rigd(
        "run", "calibrate_torque", "--rig", "angle-1", "--output", "torque.mcap", cwd=folder
    )
    assert done.code == 0, done.err
    assert "rigd calibrate --from torque.mcap" in done.out
    return folder / "torque.mcap"


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
    file.write_text(text.replace(old, new))


def campaign(folder: Path, *options: str) -> Ended:
    """Run one trial's worth of the campaign on the bench of ``folder``."""
    return rigd(
        *CAMPAIGN, "--set", "voltage=10 V", "--rig", "bench.yaml", "--output", "run.mcap",
        *options, cwd=folder,
    )  # fmt: skip


@pytest.mark.parametrize("procedure", ["calibrate_friction", "calibrate_rise"])
def test_the_shipped_calibration_is_what_its_procedures_give(procedure: str, bench: Path) -> None:
    made_as_shipped(bench, procedure)


@pytest.mark.dates
def test_shipped_load_cell_is_what_procedure_gives(bench: Path) -> None:
    text = (CONFIGS / "sim_approach_angle_cell.yaml").read_text()
    (bench / "bench.yaml").write_text(text)
    made_as_shipped(bench, "calibrate_load_cell")


@pytest.mark.dates
def test_the_shipped_scale_is_what_its_procedure_gives(bench: Path) -> None:
    made_as_shipped(bench, "calibrate_scale")


@pytest.mark.dates
def test_the_shipped_torque_is_what_its_recording_gives(torque: Path, bench: Path) -> None:
    made_as_shipped(bench, "--from", torque)


def test_campaign_with_load_cell_takes_its_normal_force(tmp_path: Path) -> None:
    chosen = ("--set", "set=clean_45", "--set", "load=6 kg", "--set", "voltage=10 V")
    found = {}
    for rig in ("angle-1", "angle-cell-1"):
        done = rigd(
            "run", "approach_angles", *chosen, "--rig", rig, "--output", f"{rig}.mcap", cwd=tmp_path
        )
        assert done.code == 0, done.err
        found[rig] = rigd("identify", f"{rig}.mcap", "--no-report", "--json", cwd=tmp_path).json
    assert any(
        "what the fast load cell shows" in text for text in found["angle-cell-1"]["statements"]
    )
    assert any("what it rises by" in text for text in found["angle-1"]["statements"])
    plain, celled = (found[rig]["runs"][0]["better"]["mu_u_k1"] for rig in found)
    assert celled < 0.9 * plain


def made_as_shipped(bench: Path, *measured_by: str | Path) -> None:
    """Calibrate: in virtual time and of the same seed it gives the last digit that is shipped."""
    shipped = load_calibration(SHIPPED)
    done = rigd(
        "calibrate", *measured_by, "--rig", "bench.yaml", *OPERATOR, "--yes", "--json", cwd=bench
    )
    assert done.code == 0, done.err
    new = load_calibration(bench / FILE)
    measured = list(done.json["values"])
    assert measured
    for name in measured:
        assert (new.values[name].value, new.values[name].u) == (
            shipped.values[name].value,
            shipped.values[name].u,
        )
        assert new.values[name].operator == "A. Miller"
    kept = {name: value for name, value in new.values.items() if name not in measured}
    assert kept == {name: value for name, value in shipped.values.items() if name not in measured}
    assert {item.name for item in new.history} == set(measured)
    assert {k: round(v, 9) for k, v in done.json["deviation"].items()} == dict.fromkeys(measured, 0)


@pytest.mark.dates
def test_shipped_calibration_stays_and_copy_is_written(torque: Path, tmp_path: Path) -> None:
    before = SHIPPED.read_text()
    done = rigd("calibrate", "--from", torque, *OPERATOR, "--valid", "30d", "--yes", cwd=tmp_path)
    assert done.code == 0, done.err
    assert "new values beside old" in done.out
    assert f"wrote {FILE}" in done.out
    assert "shipped with rigd stays as it is" in " ".join(done.out.split())
    assert SHIPPED.read_text() == before
    value = load_calibration(tmp_path / FILE).values["torque_scale"]
    assert value.valid_until is not None
    assert (value.valid_until - value.made).days == 30
    assert value.origin == "torque.mcap"
    assert value.instruments == {"daq": "serial number 00000001"}
    # Once more begins from the copy.
    assert rigd("calibrate", "--from", torque, *OPERATOR, "--yes", cwd=tmp_path).code == 0
    assert len(load_calibration(tmp_path / FILE).history) == 2


@pytest.mark.parametrize(
    "option",
    [("--set", "lever_arm=1 m"), ("--note", "x"), ("--meta", "a=b"), ("--specimen", "W7"),
     ("--seed", "2"), ("--ask",), ("--runs", "there")],
    ids=lambda option: option[0],
)  # fmt: skip
def test_options_of_run_are_refused_with_from(option: tuple[str, ...], tmp_path: Path) -> None:
    done = rigd("calibrate", "--from", "torque.mcap", *OPERATOR, *option, cwd=tmp_path)
    assert done.code == 2
    assert f"{option[0]} would change nothing: --from runs no procedure" in done.err


def test_without_terminal_and_without_yes_nothing_is_written(torque: Path, tmp_path: Path) -> None:
    done = rigd("calibrate", "--from", torque, *OPERATOR, cwd=tmp_path)
    assert done.code == 3
    assert "no terminal to ask at; give --yes" in done.err
    assert f"rigd calibrate --from {torque} --operator NAME --yes" in done.err
    done = rigd("calibrate", "--from", torque, *OPERATOR, "--json", cwd=tmp_path)
    assert done.code == 3
    assert done.json["values"].keys() == {"torque_scale"}
    assert done.json["written"] is None
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize(("answer", "code", "written"), [("yes", 0, True), ("no", 3, False)])
def test_a_person_is_asked_before_anything_is_replaced(
    torque: Path, bench: Path, answer: str, code: int, written: bool
) -> None:
    words = ["calibrate", "--from", str(torque), *OPERATOR, "--rig", "bench.yaml"]
    opposite = "yes" if answer == "no" else "no"
    terminal = Terminal.open(words, bench, early=opposite)  # no answer to what comes
    try:
        terminal.expect("Write this to")
        terminal.expect("[yes/no]: ")
        terminal.type(answer)
        assert terminal.end() == code
    finally:
        terminal.close()
    assert (load_calibration(bench / FILE).history != ()) == written


@pytest.mark.dates
def test_implausible_or_newer_value_is_remarked_on(torque: Path, bench: Path) -> None:
    text = (bench / FILE).read_text().replace("2.03537 N m/V", "2.10 N m/V")
    (bench / FILE).write_text(text.replace("made: 2026-11-26", "made: 2100-01-01", 1))
    done = rigd("calibrate", "--from", torque, "--rig", "bench.yaml", *OPERATOR, cwd=bench)
    told = " ".join(done.out.split())
    assert "torque_scale: more than 3 u from the old value" in told
    assert "torque_scale: the new value was measured before the value that it replaces" in told


def test_bad_fit_is_refused_and_nothing_is_written(bench: Path) -> None:
    """Two gauges swapped: the torque falls as the weights grow."""
    procedure = (shipped_folder("procedures") / "calibrate_torque.yaml").read_text()
    (bench / "swapped.yaml").write_text(
        procedure.replace("gauge_a: daq.gauge_a_raw", "gauge_a: daq.gauge_b_raw").replace(
            "gauge_b: daq.gauge_b_raw", "gauge_b: daq.gauge_a_raw"
        )
    )
    before = (bench / FILE).read_text()
    done = rigd("calibrate", "swapped.yaml", "--rig", "bench.yaml", *OPERATOR, "--yes", cwd=bench)
    assert done.code == 7
    assert "the gauges are swapped" in done.err
    assert "nothing is written" in done.err
    assert (bench / FILE).read_text() == before


@pytest.mark.dates
def test_a_run_records_which_calibration_it_had(bench: Path) -> None:
    assert campaign(bench).code == 0
    recording = Recording.open(bench / "run.mcap")
    attached = recording.attachments["calibration.yaml"].data.decode()
    assert attached == (bench / FILE).read_text()
    calibration = parse_calibration(attached, "calibration.yaml")
    told = recording.metadata["calibration"]
    assert told["name"] == calibration.name
    assert told["sha256"] == calibration.sha256
    shown = rigd("info", "run.mcap", cwd=bench)
    assert f"calibration {calibration.name} of {calibration.made}" in shown.out
    assert rigd("info", "run.mcap", "--json", cwd=bench).json["calibration"] == dict(told)


@pytest.mark.dates
def test_expired_value_blocks_run_that_needs_it(bench: Path) -> None:
    text = (bench / FILE).read_text()
    (bench / FILE).write_text(
        text.replace("made: 2026-11-26", "made: 2020-01-01", 1).replace(
            "valid_until: 2126-11-02", "valid_until: 2021-01-01", 1
        )
    )
    done = campaign(bench)
    assert done.code == 3
    assert f"torque_scale in {FILE} expired on 2021-01-01" in done.err
    dry = campaign(bench, "--dry-run")
    assert dry.code == 3
    assert f"torque_scale in {FILE} expired on 2021-01-01" in dry.out
    told = rigd("check", FILE, "bench.yaml", cwd=bench)
    assert told.code == 0
    assert "the first value expired on 2021-01-01" in told.out
    assert "rigd calibrate procedures/calibrate_torque.yaml --rig angle-1" in done.err
    assert not (bench / "run.mcap").exists()
    dated = rigd(
        *CAMPAIGN, "--set", "voltage=10 V", "--rig", "bench.yaml", "--start", "2020-06-01",
        "--output", "then.mcap", cwd=bench,
    )  # fmt: skip
    assert dated.code == 0, dated.err  # it was valid on the stated day of the run


@pytest.mark.dates
def test_optional_value_that_has_expired_blocks_the_run(bench: Path) -> None:
    """Without `load_rise` its uncertainty is larger; with an old one it would be wrong."""
    text = (bench / FILE).read_text()
    (value,) = re.findall(r"^  load_rise:\n(?:    .*\n)+", text, re.MULTILINE)
    old = value.replace("made: 2026", "made: 2020").replace(
        "valid_until: 2126", "valid_until: 2021"
    )
    (bench / FILE).write_text(text.replace(value, old))
    done = campaign(bench)
    assert done.code == 3
    assert f"load_rise in {FILE} expired on 2021-11-04" in done.err
    assert "rigd calibrate procedures/calibrate_rise.yaml --rig angle-1" in done.err
    (bench / FILE).write_text(text.replace(value, ""))
    assert campaign(bench).code == 0


def test_missing_file_blocks_only_runs_that_need_it(torque: Path, bench: Path) -> None:
    edit(bench / "bench.yaml", "calibration: calibrations/approach_angle.yaml",
         "calibration: mine.yaml")  # fmt: skip
    assert "calibration file mine.yaml does not exist" in rigd("check", "bench.yaml", cwd=bench).out
    done = campaign(bench)
    assert done.code == 3
    assert "there is no calibration file mine.yaml" in done.err
    made = rigd("calibrate", "--from", torque, "--rig", "bench.yaml", *OPERATOR, "--yes", cwd=bench)
    assert made.code == 0, made.err
    assert set(load_calibration(bench / "mine.yaml").values) == {"torque_scale"}
    assert "mine.yaml has no wheel_scale, platform_scale, load_scale," in campaign(bench).err


def test_another_instrument_blocks_the_run(bench: Path) -> None:
    edit(bench / "bench.yaml", "individual: 1 ", "individual: 12 ")
    done = campaign(bench)
    assert done.code == 3
    assert "serial number 0000000C" in done.err
    assert "measured with 'serial number 00000001'" in done.err
    calibrated = rigd(
        "calibrate", "calibrate_torque", "--rig", "bench.yaml", *OPERATOR, "--yes", cwd=bench
    )
    assert calibrated.code == 0, calibrated.err  # is exempt, and heals its part
    after = campaign(bench).err
    assert "torque_scale" not in after
    assert "rail_constant" in after


def test_instrument_is_checked_with_devices_in_own_processes(
    bench: Path,
) -> None:
    edit(bench / "bench.yaml", "individual: 1 ", "individual: 12 ")
    done = rigd(*CAMPAIGN, "--rig", "bench.yaml", "--pace", "1", cwd=bench)
    assert done.code == 3
    assert "measured with 'serial number 00000001'" in done.err


def test_calibration_of_another_rig_blocks_the_run(bench: Path) -> None:
    edit(bench / "bench.yaml", "rig: angle-1", "rig: my-bench")
    assert (
        "is the calibration of angle-1, angle-wire-1, angle-cell-1, not of my-bench"
        in campaign(bench).err
    )
    done = rigd(
        "calibrate", "calibrate_scale", "--rig", "bench.yaml", *OPERATOR, "--yes", cwd=bench
    )
    assert done.code == 2
    assert "not of my-bench" in done.err
    assert (bench / FILE).read_text() == SHIPPED.read_text()


def test_a_recording_that_calibrates_nothing_is_refused(bench: Path) -> None:
    assert campaign(bench).code == 0
    done = rigd("calibrate", "--from", "run.mcap", "--rig", "bench.yaml", *OPERATOR, cwd=bench)
    assert done.code == 7
    assert "does not calibrate anything" in done.err
    run = rigd("calibrate", "approach_angles", "--rig", "bench.yaml", *OPERATOR, cwd=bench)
    assert run.code == 2
    assert "procedure approach_angles calibrates nothing" in run.err
    bare = rigd("calibrate", "calibrate_torque", "--rig", "lugre-1", *OPERATOR, cwd=bench)
    assert bare.code == 2
    assert "rig lugre-1 names no calibration file" in bare.err


def test_calibration_from_truncated_recording_is_refused(torque: Path, bench: Path) -> None:
    """Six of its seven points would still make a line."""
    text = (bench / FILE).read_text()
    data = torque.read_bytes()
    (bench / "cut.mcap").write_bytes(data[: 95 * len(data) // 100])
    assert rigd("recover", "cut.mcap", cwd=bench).code == 0
    done = rigd(
        "calibrate", "--from", "cut.mcap", "--rig", "bench.yaml", *OPERATOR, "--yes", cwd=bench
    )
    assert done.code == 7
    assert "(interrupted): nothing is calibrated" in done.err
    assert "rigd run --resume cut.mcap" in done.err
    assert (bench / FILE).read_text() == text


def test_identify_shows_calibration_and_writes_only_report(torque: Path) -> None:
    done = rigd("identify", torque, cwd=torque.parent)
    assert done.code == 0, done.err
    assert "torque_scale" in done.out
    assert "Nothing is written yet: rigd calibrate --from" in " ".join(done.out.split())
    report = torque.with_suffix(".html").read_text()
    assert "length of the arm" in report
    assert "<svg" in report
    assert not (torque.parent / FILE).exists()


@pytest.mark.dates
def test_doctor_reports_remaining_days_of_calibration(bench: Path) -> None:
    done = rigd("doctor", "--rig", "bench.yaml", "--seconds", "0.5", "--json", cwd=bench)
    (check,) = [item for item in done.json["checks"] if item["name"] == "calibration"]
    assert check["verdict"] == "ok"
    assert check["figures"]["days_left"] > 30_000
    edit(bench / "bench.yaml", "calibration: calibrations/", "calibration: nowhere/")
    done = rigd("doctor", "--rig", "bench.yaml", "--seconds", "0.5", "--json", cwd=bench)
    (check,) = [item for item in done.json["checks"] if item["name"] == "calibration"]
    assert (done.code, check["verdict"]) == (3, "fail")
