"""Calculations in a process of their own."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import threading
import time
from pathlib import Path

import pytest
from support.wire import ROOT

import rigd
from rigd.analysis.plan import judged
from rigd.config.calibration.calibration import load_calibration
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.daemon.serve.compared_pages import ComparedPages
from rigd.daemon.serve.recordings import is_drawn
from rigd.daemon.serve.worker import CalculationWorker
from rigd.model.channels import Channel, Stream
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure, parse_procedure
from rigd.record import RecordingWriter
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.results import CheckReport
from rigd.remote.server import working_for

QUICK = (ROOT / "procedures" / "quick.yaml").read_text()


def test_dry_run_returns_steps_time_and_peaks() -> None:
    rig = load_rig("lugre-1")
    done = CalculationWorker().dry_run(
        rig.source.text, rig.source.path, QUICK, "quick", {"current": "1.2 A"}
    )
    assert done.ok
    assert done.trials == 1
    assert 4.0 < done.duration_s < 30.0
    assert {"home", "drive", "brake"} <= {step.name for step in done.steps}
    (current,) = (
        peak for peak in done.peaks if peak.channel.startswith("wheel_servo.current (set")
    )
    assert current.highest == pytest.approx(1.2)


def test_dry_run_of_real_rig_plays_its_sibling() -> None:
    rig = load_rig("wire-1")
    done = CalculationWorker().dry_run(rig.source.text, rig.source.path, QUICK, "quick", {})
    assert done.ok
    assert done.physics == "sibling"
    assert done.sibling.startswith("lugre-1")
    assert "device traction" in {item.what for item in done.differences}
    assert done.peaks


def test_dry_run_without_sibling_has_no_peaks() -> None:
    rig = load_rig("wire-1")
    text = rig.source.text.replace("sibling: sim_lugre.yaml", "")
    done = CalculationWorker().dry_run(text, rig.source.path, QUICK, "quick", {})
    assert (done.ok, done.physics, done.peaks) == (True, "none", ())
    assert {step.timing for step in done.steps} == {"known", "at_most"}
    assert done.known_s is not None
    assert done.known_s < done.duration_s


def test_calibration_that_blocks_run_refuses_dry_run() -> None:
    rig = load_rig("angle-wire-1")
    text = rig.source.text.replace("sibling: sim_approach_angle.yaml", "")
    text = text.replace("calibrations/approach_angle.yaml", "calibrations/absent.yaml")
    angles = (ROOT / "procedures" / "approach_angles.yaml").read_text()
    done = CalculationWorker().dry_run(text, rig.source.path, angles, "approach_angles", {})
    assert not done.ok
    assert any("there is no calibration file" in reason for reason in done.refusals)


def test_plan_its_analysis_refuses_is_wrong_here_too() -> None:
    rig = load_rig("lugre-1")
    text = QUICK + "identify: {model: lugre, signals: {wheel_current: wheel_servo.current}}\n"
    found = CalculationWorker().check(rig.source.text, rig.source.path, text, "quick", {})
    assert not found.ok
    assert "identify: model lugre needs the signal" in found.problems[0].message


def test_wrong_sibling_is_refused_with_places(tmp_path: Path) -> None:
    rig = load_rig("wire-1")
    text = rig.source.text.replace("sim_lugre.yaml", "absent.yaml")
    with pytest.raises(
        Refusal, match=r"rig\.yaml:\d+:10: the sibling .* does not exist"
    ) as refused:
        CalculationWorker().dry_run(text, tmp_path / "rig.yaml", QUICK, "quick", {})
    assert refused.value.code is Code.WRONG


def test_refusals_of_a_dry_run_are_returned() -> None:
    rig = load_rig("lugre-1")
    with pytest.raises(Refusal, match="curent") as refused:
        CalculationWorker().dry_run(
            rig.source.text, rig.source.path, QUICK, "quick", {"curent": "1 A"}
        )
    assert refused.value.code is Code.WRONG


#: 1001 trials of 19 steps.
LONG = """\
procedure: long
title: Long
doc: For tests.
parameters: {current: {doc: Current, unit: A}}
sweep: {grid: {current: {from: 0 A, to: 1 A, step: 0.001 A}}}
trial:
  steps:
""" + "".join(
    f"    - {{step: s{n}, set: {{wheel_servo.current: '${{current}}'}}, for: 0.1 s}}\n"
    for n in range(19)
)


def check(aside: CalculationWorker, text: str = LONG) -> CheckReport:
    rig = load_rig("lugre-1")
    return aside.check(rig.source.text, rig.source.path, text, "long", {})


def test_long_check_completes_in_worker() -> None:
    assert check(CalculationWorker()) == CheckReport(ok=True, trials=1001, prompts=0)


def test_check_that_takes_too_long_is_given_up() -> None:
    with pytest.raises(Refusal, match=r"check .*cancelled.* 0\.1 s"):
        check(CalculationWorker(0.1))


def test_check_beyond_memory_bound_is_given_up() -> None:
    longer = LONG.replace("0.001 A", "0.0002 A")
    with pytest.raises(Refusal, match="check needs more than 60 MB of memory"):
        check(CalculationWorker(memory=60 << 20), longer)


def test_a_check_ends_with_its_client() -> None:
    with working_for(lambda: False), pytest.raises(Refusal, match="its client is gone"):
        check(CalculationWorker())


def test_identification_writes_its_report_beside_the_recording(tmp_path: Path) -> None:
    rig = load_rig("lugre-1")
    text = (ROOT / "procedures" / "constant_current.yaml").read_text()
    few = text.replace("step: 0.15 A", "step: 0.45 A")
    assert few != text
    procedure = compile_procedure(parse_procedure(few, tmp_path / "few.yaml"), rig)
    recording = tmp_path / "run.mcap"
    execute(RunRequest(procedure, few, rig, seed=1, output=recording))
    told = CalculationWorker().identify(recording)
    report = tmp_path / "run.html"
    assert (told.run, told.size) == ("run.mcap", report.stat().st_size)
    assert "<html" in report.read_text()


def test_calibration_is_shown_then_written(tmp_path: Path) -> None:
    configs, file = ROOT / "configs", tmp_path / "calibrations" / "approach_angle.yaml"
    file.parent.mkdir()
    shutil.copy(configs / "calibrations" / "approach_angle.yaml", file)
    shutil.copy(configs / "sim_approach_angle.yaml", tmp_path / "bench.yaml")
    rig = load_rig(tmp_path / "bench.yaml")
    source = load_procedure("calibrate_scale")
    recording = tmp_path / "run.mcap"
    execute(RunRequest(judged(source, rig, {}), source.file.text, rig, seed=2, output=recording))
    before = file.read_text()
    asked = (rig.source.text, rig.source.path, recording, "Ada (panel)", 180)
    shown = CalculationWorker().calibrate(*asked, write=False)
    (value,) = shown.values
    assert (shown.file, shown.operator, shown.written) == (file.name, "Ada (panel)", False)
    assert value.name == "load_scale" and value.old and value.deviation is not None
    assert file.read_text() == before
    assert CalculationWorker().calibrate(*asked, write=True).written
    held = load_calibration(file)
    new = held.values["load_scale"]
    assert (new.origin, new.operator) == ("run.mcap", "Ada (panel)")
    assert str(new.valid_until) == shown.valid_until
    assert [item.name for item in held.history] == ["load_scale"]
    other = rig.source.text.replace("rig: angle-1", "rig: angle-wire-1")
    with pytest.raises(Refusal, match="recorded on rig angle-1, not on angle-wire-1"):
        CalculationWorker().calibrate(other, *asked[1:], write=True)


def test_shipped_calibration_is_not_written_from_afar(tmp_path: Path) -> None:
    rig = load_rig("angle-1")
    with pytest.raises(Refusal, match="shipped with rigd") as refused:
        CalculationWorker().calibrate(
            rig.source.text, rig.source.path, tmp_path / "run.mcap", "Ada", 365, write=True
        )
    assert "serve a copy of the rig file" in str(refused.value)


def test_data_that_cannot_answer_make_no_report(tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    stream = Stream("axis", (Channel("position", "m"),))
    RecordingWriter.create(
        recording, streams=[stream], metadata={}, attachments=(), start_ns=1_000
    ).close()
    with pytest.raises(Refusal) as refused:
        CalculationWorker().identify(recording)
    assert refused.value.code is Code.REFUSED
    assert not (tmp_path / "run.html").exists()


def test_drawing_writes_the_page_beside_the_recording(tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    stream = Stream("axis", (Channel("position", "m"),))
    RecordingWriter.create(
        recording, streams=[stream], metadata={}, attachments=(), start_ns=1_000
    ).close()
    told = CalculationWorker().draw(recording)
    page = tmp_path / "run-run.html"
    assert (told.run, told.size) == ("run.mcap", page.stat().st_size)
    assert "No trial began" in page.read_text()
    assert is_drawn(recording)
    later = page.stat().st_mtime_ns + 1_000_000_000
    os.utime(recording, ns=(later, later))
    assert not is_drawn(recording)  # it has been gone on with


def test_comparison_is_kept_until_recording_changes(tmp_path: Path) -> None:
    recordings = [tmp_path / "b1.mcap", tmp_path / "b2.mcap"]
    for seed, recording in enumerate(recordings, start=1):
        rigd.run("breakaway", rig="lugre-1", out=recording, seed=seed)
    files = sorted(tmp_path.iterdir())
    worker = CalculationWorker()
    pages = ComparedPages(worker)
    first = pages.piece(recordings, 0, 1000)
    page = pages.piece(recordings, 0, first.size)
    assert page.data[:1000] == first.data
    assert hashlib.sha256(page.data).hexdigest() == first.sha256
    text = page.data.decode()
    assert "Comparison of campaigns" in text and "b2.mcap" in text
    assert str(tmp_path) not in text
    assert sorted(tmp_path.iterdir()) == files
    with pytest.raises(Refusal, match="none at"):
        pages.piece(recordings, first.size + 1, 1)
    os.utime(recordings[0], ns=(1, 1))
    worker.close()
    with pytest.raises(Refusal, match="the daemon is ending"):
        pages.piece(recordings, 0, 1)


@pytest.mark.timeout(900)  # at low priority, beside others that compute
def test_recordings_that_differ_in_kind_are_not_compared(tmp_path: Path) -> None:
    for name in ("a", "b"):
        RecordingWriter.create(
            tmp_path / f"{name}.mcap", streams=[Stream("axis", (Channel("position", "m"),))],
            metadata={}, attachments=(), start_ns=1_000,
        ).close()  # fmt: skip
    pages = ComparedPages(CalculationWorker())
    with pytest.raises(Refusal) as refused:
        pages.piece([tmp_path / "a.mcap", tmp_path / "b.mcap"], 0, 1)
    assert refused.value.code is Code.REFUSED


def test_killed_calculation_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed = tmp_path / "python"
    killed.write_text("#!/bin/sh\ncat > /dev/null\nkill -KILL $$\n")
    killed.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(killed))
    with pytest.raises(Refusal, match=r"identify .*SIGKILL"):
        CalculationWorker().identify(tmp_path / "run.mcap")


def test_dry_run_ends_when_a_run_begins() -> None:
    rig, aside, ended = load_rig("lugre-1"), CalculationWorker(), list[Refusal]()

    def long() -> None:
        try:
            while True:  # one is under way, however long it takes
                aside.dry_run(rig.source.text, rig.source.path, QUICK, "quick", {})
        except Refusal as refusal:
            ended.append(refusal)

    work = threading.Thread(target=long)
    work.start()
    deadline = time.monotonic() + 60
    while work.is_alive() and time.monotonic() < deadline:
        aside.cancel("identify", "nobody asked")
        aside.cancel("dry_run", "a run begins")
        work.join(0.05)
    assert [item.message for item in ended] == ["dry_run was cancelled: a run begins"]


def test_one_calculation_at_time_and_none_outlives_daemon() -> None:
    rig, aside, ended = load_rig("lugre-1"), CalculationWorker(), list[Refusal]()

    def long() -> None:
        try:
            aside.dry_run(rig.source.text, rig.source.path, QUICK, "quick", {})
        except Refusal as refusal:
            ended.append(refusal)

    work = threading.Thread(target=long)
    work.start()
    deadline = time.monotonic() + 30
    busy: Refusal | None = None
    while busy is None and time.monotonic() < deadline:
        try:
            # It would be refused at once, were it begun.
            aside.dry_run("rig: none", Path("rig.yaml"), "procedure: none", "none", {})
        except Refusal as refusal:
            busy = refusal if refusal.code is Code.BUSY else None
    assert busy is not None
    aside.close()
    work.join()
    assert [item.message for item in ended] == ["the daemon is ending"]
    with pytest.raises(Refusal, match="the daemon is ending"):
        aside.identify(Path("run.mcap"))
