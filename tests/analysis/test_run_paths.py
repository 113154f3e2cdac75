"""Paths of bodies on the page of a run: interrupted wherever a line would mislead."""

from __future__ import annotations

import math
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis.report.svg import drawing_style
from rigd.analysis.run_page import run_report, samples
from rigd.analysis.run_page.figures import planes
from rigd.analysis.run_page.groups import Groups
from rigd.analysis.run_page.paths import BodyPath, path_of
from rigd.analysis.run_page.samples import Attempt, gather, shared_time
from rigd.model.channels import Channel, Stream
from rigd.model.poses import poses_of
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.record import Recording, RecordingWriter

START_NS = 1_790_000_000_000_000_000
MARKER = Stream("marker", (Channel("x", "m"), Channel("y", "m"), Channel("heading", "rad")))
(POSE,) = poses_of([MARKER])
NO_GROUPS = Groups("", (), (), {})


def circle(points: int = 500, rate_hz: float = 25.0) -> NDArray[np.void]:
    """Return rows of a body that goes once round a circle of 2 m about (5, 1) m."""
    rows = np.zeros(points, row_dtype(MARKER))
    rows[TIME_FIELD] = START_NS + np.arange(points) * round(1e9 / rate_hz)
    angle = np.linspace(0.0, 2.0 * math.pi, points)
    rows["x"], rows["y"] = 5.0 + 2.0 * np.cos(angle), 1.0 + 2.0 * np.sin(angle)
    rows["heading"] = angle + 0.5 * math.pi
    return rows


def walked(rows: NDArray[np.void], points: int = 10_000) -> BodyPath:
    path = path_of(POSE, rows, points)
    assert path is not None
    return path


def breaks(path: BodyPath) -> int:
    return int(np.count_nonzero(np.isnan(path.x)))


def test_thinned_path_stays_on_the_circle() -> None:
    path = walked(circle(), points=60)
    assert path.x.size == 60
    np.testing.assert_allclose(np.hypot(path.x - 5.0, path.y - 1.0), 2.0)
    assert path.heading == pytest.approx(2.5 * math.pi)


@pytest.mark.parametrize("points", [40, 10_000])
def test_path_is_interrupted_while_body_is_lost(points: int) -> None:
    rows = circle()
    assert breaks(walked(rows, points)) == 0
    assert breaks(walked(np.delete(rows, slice(100, 105)), points)) == 0, "0.24 s"
    assert breaks(walked(np.delete(rows, slice(100, 120)), points)) == 1, "0.84 s"
    blind = rows.copy()
    blind["x"][200:300] = math.nan
    assert breaks(walked(blind, points)) == 1


def test_rows_of_a_slow_body_are_joined() -> None:
    assert breaks(walked(circle(rate_hz=0.5))) == 0


def test_body_that_was_put_elsewhere_leaves_no_line() -> None:
    rows = circle()
    rows["x"][250:] += 30.0
    assert breaks(walked(rows)) == 1


def test_single_pose_of_another_body_stays_visible() -> None:
    """A camera that exchanged two markers is a defect to be seen."""
    rows = circle()
    rows["x"][250] += 1.0
    assert breaks(walked(rows)) == 0


def test_rows_without_a_position_give_no_path() -> None:
    rows = circle(3)
    rows["y"] = math.nan
    assert path_of(POSE, rows, 100) is None


def test_both_axes_have_one_scale() -> None:
    paths = {"wide": {0: walked(circle())}, "other": {0: walked(circle())}}
    with drawing_style():
        figure = planes(paths, (3.0, 7.0, -1.0, 3.0), NO_GROUPS)
        for ax in figure.axes:
            origin, right, up = ax.transData.transform([(5.0, 1.0), (6.0, 1.0), (5.0, 2.0)])
            assert right[0] - origin[0] == pytest.approx(up[1] - origin[1])
            (low, high), (foot, head) = ax.get_xlim(), ax.get_ylim()
            assert low < 3.0 < 7.0 < high
            assert foot < -1.0 < 3.0 < head


def test_page_shows_paths_of_a_recording(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    with RecordingWriter.create(
        file, streams=[MARKER], metadata={}, attachments=[], start_ns=START_NS, sync_interval_s=None
    ) as writer:
        writer.write("marker", circle())
    text = unescape(run_report(file))
    assert '<section id="plane">' in text
    assert "marker: x 3 to 7 m, y −1 to 3 m" in text


@pytest.mark.parametrize("piece_rows", [1_000, 150])
def test_path_is_interrupted_between_two_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece_rows: int
) -> None:
    monkeypatch.setattr(samples, "PIECE_ROWS", piece_rows)
    rows = circle()
    rows[TIME_FIELD][250:] += 20_000_000_000  # the hole is from 10 s to 30 s of 40 s
    with RecordingWriter.create(
        file := tmp_path / "run.mcap", streams=[MARKER], metadata={}, attachments=[],
        start_ns=START_NS, sync_interval_s=None,
    ) as writer:  # fmt: skip
        writer.write("marker", rows)
    whole = Attempt(0, START_NS, START_NS + 40_000_000_000)
    found = gather(Recording.open(file), [whole], shared_time([whole], [], ()), {}, {})
    assert breaks(found.paths["marker"][0]) == 1
