"""The page of a run: what was recorded is on it, for any recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from numpy.typing import NDArray
from support.panel.markup import outline

from rigd.analysis.report.layout import Panel
from rigd.analysis.run_page import parse_selection, run_report, samples
from rigd.analysis.run_page.figures import Shown, StepSpan, one_trial
from rigd.analysis.run_page.samples import Attempt, gather, shared_time
from rigd.model.channels import STALE, STATUS_FIELD, Channel, Stream
from rigd.model.errors import ConfigError, DataError, RecordingError
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.record import Attachment, Recording, RecordingWriter

START_NS = 1_790_000_000_000_000_000
RATE_HZ = 1000
AXIS = Stream(
    "axis",
    (Channel("position", "m", doc="where it is"), Channel("position_raw", "V", raw_of="position"),
     Channel("speed_setpoint", "m/s")),
    has_status=True,
)  # fmt: skip
RIG = """\
rig: bench
title: A bench
cycle: 1 kHz
devices:
  axis:
    driver: not-installed-here
    limits:
      speed: {low: -0.5 m/s, high: 0.5 m/s, rate: 1 m/s^2}
interlocks:
  - {name: far_end, source: axis.position, high: 1100 mm, action: abort, message: Too far.}
"""
HOSTILE = "<script>alert(1)</script> & \"x\" 'y' $\\alpha$ ]]> --> {{ 7*7 }} \x1b[31m \u202e"
RUN = {
    "procedure": "staircase", "title": "A staircase", "rig": "bench",
    "mode": "simulated, virtual time", "started": "2020-01-02T00:00:00+00:00",
}  # fmt: skip

Event = tuple[float, str, int, Mapping[str, Any]]


def begun(number: int, at_s: float, value: float = 0.1) -> list[Event]:
    """Return the events of a trial that begins, with its two steps."""
    data = {"number": number, "repeat": 1, "parameters": {"current": value, "floor": "pvc"},
            "units": {"current": "A"}}  # fmt: skip
    return [
        (at_s, "trial_start", number, data),
        (at_s, "step", number, {"name": "settle"}),
        (at_s + 0.2, "step", number, {"name": "drive"}),
    ]


def ended(number: int, at_s: float, reason: str = "all steps played") -> Event:
    """Return the end of a trial."""
    complete = reason == "all steps played"
    return at_s, "trial_end", number, {"complete": complete, "reason": reason}


def ramp(seconds: float) -> NDArray[np.void]:
    """Return rows of a position that goes from 0 to 1 m."""
    rows = np.zeros(round(seconds * RATE_HZ), row_dtype(AXIS))
    rows[TIME_FIELD] = START_NS + np.arange(len(rows)) * (1_000_000_000 // RATE_HZ)
    rows["position"] = np.linspace(0.0, 1.0, len(rows))
    return rows


def record(
    path: Path,
    events: Sequence[Event] = (),
    rows: NDArray[np.void] | None = None,
    run: Mapping[str, str] = RUN,
    rig: str = RIG,
    procedure: str = "",
    stream: Stream = AXIS,
    **metadata: Mapping[str, str],
) -> Path:
    """Write a recording of one device."""
    attached = [Attachment("rig.yaml", "application/yaml", rig.encode())]
    if procedure:
        attached.append(Attachment("procedure.yaml", "application/yaml", procedure.encode()))
    with RecordingWriter.create(
        path, streams=[stream], metadata={"run": run, **metadata}, attachments=attached,
        start_ns=START_NS, sync_interval_s=None,
    ) as writer:  # fmt: skip
        for at_s, kind, trial, data in events:
            writer.event(START_NS + round(at_s * 1e9), kind, trial, data)
        writer.write("axis", ramp(1.0) if rows is None else rows)
    return path


def text_of(path: Path, **options: Any) -> str:
    """Return the page of a recording, after checking that it is whole and loads nothing."""
    page = run_report(path, **options)
    found = outline(page)
    assert found.faults == []
    assert found.open == []
    assert found.targets <= set(found.ids)
    assert not {"script", "link", "iframe", "img", "image"} & set(found.tags)
    return unescape(page)


ONE = [*begun(1, 0.0), ended(1, 1.0), (1.0, "run_end", -1, {"state": "complete"})]


def test_trial_is_shown_with_parameters_steps_and_end(tmp_path: Path) -> None:
    text = text_of(record(tmp_path / "run.mcap", ONE))
    assert "<h1>A staircase</h1>" in text
    assert "<strong>current</strong> 0.1 A" in text
    assert "settle 0.00 to 0.20 s; drive 0.20 to 1.00 s" in text
    assert "all steps played" in text
    assert "axis.position" in text


PROCEDURE = """\
procedure: staircase
title: A staircase
doc: For tests.
parameters: {current: {doc: Current, unit: A}, floor: {doc: Floor, choices: [pvc]}}
trial: {steps: [{step: settle, for: 0.2 s}, {step: drive, for: 0.8 s}]}
measure: {way: {max: axis.position, during: drive, unit: mm, doc: "<b>Way</b>"}}
accept: {way: [1 m, 2 m]}
"""


def test_page_shows_measures_with_verdict(tmp_path: Path) -> None:
    text = text_of(record(tmp_path / "run.mcap", ONE, procedure=PROCEDURE))
    assert '<th scope="row">way [mm]</th>' in text
    assert "not decided" in text
    assert "one trial shows no repeatability" in text
    assert "repeatability only (type A)" in text


def test_measures_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    other = PROCEDURE.replace("axis.position", "axis.way")
    text = text_of(record(tmp_path / "run.mcap", ONE, procedure=other))
    assert "could not be read: the rig bench has no channel 'axis.way'" in text
    assert "axis.position" in text


def test_every_second_step_of_trial_is_shaded() -> None:
    steps = [StepSpan(0.0, 0.2, "settle"), StepSpan(0.2, 0.7, "drive"), StepSpan(0.7, 1.0, "rest")]
    shown = [Shown("axis", Panel(("position",), "m")), Shown("axis", Panel(("speed",), "m/s"))]
    figure = one_trial(shown, {}, 1.0, steps, (), {})
    for ax in figure.axes[: len(shown)]:
        (shade,) = ax.collections
        extents = [path.get_extents() for path in shade.get_paths()]
        assert [(box.x0, box.x1) for box in extents] == [(0.2, 0.7)]
    assert "drive" in [text.get_text() for text in figure.texts]


def test_parameters_that_vary_are_columns(tmp_path: Path) -> None:
    events = [*begun(1, 0.0, 0.1), ended(1, 0.5), *begun(2, 0.5, 0.2), ended(2, 1.0)]
    text = text_of(record(tmp_path / "run.mcap", events))
    assert '<th scope="col">current</th>' in text
    assert '<td class="value">0.2 A</td>' in text
    assert "<strong>floor</strong> pvc" in text
    assert "Colours: current." in text


def test_bounds_are_drawn_without_the_driver(tmp_path: Path) -> None:
    text = text_of(record(tmp_path / "run.mcap", ONE))
    assert "≤ 1.1 (interlock far_end)" in text
    assert "≥ −0.5 (limit)" in text
    assert "≤ 0.5 (limit)" in text


def test_values_and_bounds_are_in_display_unit(tmp_path: Path) -> None:
    shown = replace(AXIS, channels=(replace(AXIS.channels[0], display="mm"), *AXIS.channels[1:]))
    path = record(tmp_path / "run.mcap", ONE, stream=shown)
    assert Recording.open(path).streams["axis"] == shown
    text = text_of(path)
    assert "≤ 1100 (interlock far_end)" in text
    assert "position [mm]" in text
    assert "≥ −0.5 (limit)" in text  # of the speed, in SI


def test_unreadable_rig_file_is_reported(tmp_path: Path) -> None:
    text = text_of(record(tmp_path / "run.mcap", ONE, rig="rig: [unclosed"))
    assert "limits are not drawn" in text
    assert "axis.position" in text


def test_peak_of_one_sample_is_never_hidden(tmp_path: Path) -> None:
    rows = ramp(60.0)
    rows["position"][31_234] = 7.0
    recording = Recording.open(record(tmp_path / "run.mcap", (), rows))
    whole = Attempt(0, START_NS, START_NS + 60_000_000_000)
    found = gather(recording, [whole], shared_time([whole], [], ()), {0: 0}, {0: 250})
    trace = found.traces[0]["axis.position"]
    assert trace.values.max() == 7.0
    assert trace.values.size <= 500
    assert trace.t_s[trace.values.argmax()] == pytest.approx(31.234)
    assert np.nanmax(found.bands[0]["axis.position"].high) == 7.0
    assert found.extremes["axis.position"] == (0.0, 7.0)
    assert "axis.position_raw" not in found.extremes


@pytest.mark.parametrize(
    ("recorded", "drawn_through"),
    [
        ("{when: axis.position > 50 mm, before: 2 s, after: 5 s}", False),
        ("{every: 1, during: [drive]}", False),
        ("1", True),
    ],
)
def test_no_line_leads_through_time_unrecorded(
    tmp_path: Path, recorded: str, drawn_through: bool
) -> None:
    rows = ramp(1.0)
    rows[TIME_FIELD][500:] += 3_000_000_000
    procedure = f"record: {{axis: {recorded}}}\n"
    recording = Recording.open(record(tmp_path / "run.mcap", (), rows, procedure=procedure))
    whole = Attempt(0, START_NS, START_NS + 4_000_000_000)
    found = gather(recording, [whole], shared_time([whole], [], ()), {0: 0}, {0: 250})
    trace = found.traces[0]["axis.position"]
    between = trace.values[(trace.t_s > 0.5) & (trace.t_s < 3.5)]
    assert np.isnan(between).tolist() == ([] if drawn_through else [True])
    assert np.isfinite(trace.values).sum() == 500


@pytest.mark.parametrize("piece_rows", [700, 250, 90])
def test_hole_between_two_pieces_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece_rows: int
) -> None:
    rows = ramp(1.0)
    rows[TIME_FIELD][500:] += 3_000_000_000  # the hole is from 0.5 s to 3.5 s of 4 s
    monkeypatch.setattr(samples, "PIECE_ROWS", piece_rows)
    procedure = "record: {axis: {every: 1, during: [drive]}}\n"
    recording = Recording.open(record(tmp_path / "run.mcap", (), rows, procedure=procedure))
    whole = Attempt(0, START_NS, START_NS + 4_000_000_000)
    found = gather(recording, [whole], shared_time([whole], [], ()), {0: 0}, {0: 250})
    trace = found.traces[0]["axis.position"]
    assert np.all(np.diff(trace.t_s) > 0.0)
    assert trace.t_s[np.isnan(trace.values)].tolist() == pytest.approx([2.0], abs=0.01)


def test_long_streams_are_read_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording.open(record(tmp_path / "run.mcap", (), ramp(10.0)))
    whole = Attempt(0, START_NS, START_NS + 10_000_000_000)
    arguments = (recording, [whole], shared_time([whole], [], ()), {0: 0}, {0: 250})
    at_once = gather(*arguments)
    monkeypatch.setattr(samples, "PIECE_ROWS", 700)
    sizes: list[int] = []
    read = Recording.read

    def counted(recording: Recording, stream: str, first: int, last: int) -> NDArray[np.void]:
        rows = read(recording, stream, first, last)
        sizes.append(len(rows))
        return rows

    monkeypatch.setattr(Recording, "read", counted)
    in_pieces = gather(*arguments)
    assert sum(sizes) == 10_000
    assert max(sizes) <= 700
    for low, high in zip(
        (at_once.bands[0]["axis.position"].low, at_once.bands[0]["axis.position"].high),
        (in_pieces.bands[0]["axis.position"].low, in_pieces.bands[0]["axis.position"].high),
        strict=True,
    ):
        np.testing.assert_array_equal(low, high)
    assert in_pieces.extremes == at_once.extremes
    assert in_pieces.traces[0]["axis.position"].t_s.size <= 2 * 250 + 60


def test_stale_rows_and_limited_setpoints_are_per_trial(tmp_path: Path) -> None:
    rows = ramp(1.0)
    rows[STATUS_FIELD][600:612] = STALE
    events = [*begun(1, 0.0), ended(1, 0.5), *begun(2, 0.5),
              (0.7, "limit", 2, {"setpoints": ["axis.speed"]}), ended(2, 1.0)]  # fmt: skip
    text = text_of(record(tmp_path / "run.mcap", events, rows))
    table = text.split('id="trials"')[1].split("</table>")[0]
    second = table.split('<th scope="row">2</th>')[1]
    assert "<td>axis.speed</td><td>12</td>" in second
    assert "axis.speed" not in table.split('<th scope="row">2</th>')[0]
    assert "limit cuts axis.speed at 0.200 s" in text


def test_trial_ended_early_is_drawn_with_its_reason(tmp_path: Path) -> None:
    events: list[Event] = []
    for number in range(1, 41):
        reason = "interlock far_end" if number == 33 else "all steps played"
        at_s = (number - 1) * 0.025
        events += [*begun(number, at_s, number / 100)[:2], ended(number, at_s + 0.025, reason)]
    events.append((0.81, "interlock", 33, {"name": "far_end", "action": "end_trial"}))
    path = record(tmp_path / "run.mcap", events)
    text = text_of(path)
    assert "<strong>Trial 33</strong>" in text
    assert "<strong>Trial 40</strong>" not in text
    assert "6 of 40 trials are drawn" in text
    assert "interlock far_end at 0.010 s" in text
    assert "Bands reach" in text
    text = text_of(path, selection=parse_selection("40,7-8"))
    assert "<strong>Trial 40</strong>" in text
    assert "<strong>Trial 33</strong>" not in text
    with pytest.raises(DataError, match="no trial 41"):
        run_report(path, parse_selection("41"))


@pytest.mark.parametrize("text", ["", "a", "1-", "5-2", "1,,2", "1-99999999"])
def test_selection_that_names_no_trials_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_selection(text)


@pytest.mark.parametrize("value", [5e-324, 1.7976931348623157e308, -1e308, np.inf])
def test_extreme_numbers_leave_the_page_whole(tmp_path: Path, value: float) -> None:
    rows = ramp(1.0)
    rows["position"][::3] = value
    page = text_of(record(tmp_path / "run.mcap", ONE, rows))
    assert "position" in page


def test_recording_without_trials_shows_all_of_itself(tmp_path: Path) -> None:
    text = text_of(record(tmp_path / "run.mcap", [(0.0, "run_start", -1, {})]))
    assert "No trial began" in text
    assert "The whole recording" in text
    assert "interrupted" in text


def test_recording_without_rows_is_reported(tmp_path: Path) -> None:
    text = text_of(record(tmp_path / "run.mcap", ONE, ramp(0.0)))
    assert "no samples were recorded in this trial" in text
    assert "No sample can be shown" in text


def test_page_of_damaged_recording_reports_the_damage(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", ONE, ramp(5.0))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    text = text_of(path)
    assert "run.mcap is damaged; the damaged parts were skipped" in text
    assert str(tmp_path) not in text  # its folder is private
    path.write_bytes(b"not a recording")
    with pytest.raises(RecordingError):
        run_report(path)


def test_recording_of_another_program_gives_a_page(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("x/Y", "ros2msg", b"float64 force\n")
        channel = writer.register_channel("/cell", "cdr", schema)
        for i in range(20):
            data = b"\x00\x01\x00\x00" + np.float64(i).tobytes()
            writer.add_message(channel, START_NS + i * 1_000_000, data, START_NS)
        writer.finish()  # type: ignore[no-untyped-call]
    text = text_of(path)
    assert "<h1>foreign.mcap</h1>" in text
    assert "no recording of a run" in text
    assert "cell.force" in text
    assert "SIMULATED" not in text


def test_names_and_words_of_recording_are_only_text(tmp_path: Path) -> None:
    events: list[Event] = [
        (0.0, "trial_start", 1, {"number": 1, "parameters": {HOSTILE: HOSTILE}, "units": {}}),
        (0.1, "step", 1, {"name": HOSTILE}),
        (0.2, "interlock", 1, {"name": HOSTILE, HOSTILE: [HOSTILE]}),
        ended(1, 0.4, HOSTILE),
        (0.4, "trial_start", 2, {"number": 2, "parameters": {HOSTILE: "b"}, "units": {}}),
        ended(2, 1.0, HOSTILE),
        (1.0, "run_end", -1, {"state": HOSTILE, "reason": HOSTILE}),
    ]
    run = dict.fromkeys((*RUN, "operator", "note"), HOSTILE)
    path = record(tmp_path / "<b>&.mcap", events, run=run, meta={HOSTILE: HOSTILE},
                  identify={"model": HOSTILE, "group_by": HOSTILE}, rig=HOSTILE)  # fmt: skip
    page = run_report(path)
    assert "<script" not in page
    assert "<b>" not in page
    found = outline(page)
    assert found.faults == []
    assert not {"script", "b"} & set(found.tags)


def test_damaged_chunk_is_passed_over_and_named(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", ONE, ramp(20.0))
    recording = Recording.open(path)
    chunk = recording.contents.chunks[7]
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    path.write_bytes(bytes(data))
    text = text_of(path)
    assert "run.mcap is damaged; the damaged parts were skipped" in text
    assert "run.mcap lacks" in text
    assert "axis.position" in text
    recording = Recording.open(path, partial=True)
    (gap,) = (item for item in recording.gaps if item.stream == "axis")
    whole = Attempt(0, START_NS, START_NS + 20_000_000_000)
    found = gather(recording, [whole], shared_time([whole], [], ()), {}, {0: 250})
    trace = found.traces[0]["axis.position"]
    (broken,) = np.flatnonzero(np.isnan(trace.values))
    assert trace.t_s[broken] == pytest.approx((gap.start_ns - START_NS) * 1e-9)


def test_campaign_of_two_hundred_trials_stays_small(tmp_path: Path) -> None:
    events: list[Event] = []
    for number in range(1, 201):
        at_s = (number - 1) * 0.1
        events += [*begun(number, at_s, number / 1000)[:2], ended(number, at_s + 0.1)]
    rows = ramp(20.0)
    rows["position"] = np.random.default_rng(1).normal(size=len(rows))
    page = run_report(record(tmp_path / "run.mcap", events, rows))
    assert len(page.encode()) < 1e6
    assert "200 trials with their parameters" in page
