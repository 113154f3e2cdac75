"""Recordings as clients see them."""

from __future__ import annotations

import base64
import hashlib
import os
from pathlib import Path

import pytest
from mcap.writer import Writer

from rigd.daemon.serve.recordings import Recordings, interrupted
from rigd.model import RecordingError
from rigd.model.channels import Channel, Stream
from rigd.record import NO_TRIAL, RecordingWriter, recover
from rigd.remote.protocol import Code, Refusal, as_json
from rigd.remote.protocol.limits import MAX_PIECE_BYTES

AXIS = Stream("axis", (Channel("position", "m"),))


def record(
    path: Path,
    *,
    rig: str = "bench",
    state: str = "complete",
    ended: bool = True,
    started: str = "2026-11-21T08:00:00+00:00",
    mode: str = "hardware",
) -> Path:
    run = {"procedure": "sweep", "rig": rig, "seed": "1", "trials": "2", "started": started}
    run["mode"] = mode
    with RecordingWriter.create(
        path,
        streams=[AXIS],
        metadata={
            "run": run,
            "overrides": {"floor": "pvc", "load": "2 N"},
            "specimen": {"name": "W7"},
        },
        attachments=(),
        start_ns=1_000,
        sync_interval_s=None,
    ) as writer:
        writer.event(1_000, "run_start", NO_TRIAL, {})
        writer.event(2_000, "trial_start", 1, {"number": 1, "parameters": {"speed": 0.1}})
        writer.event(3_000, "trial_end", 1, {"complete": True, "reason": ""})
        if ended:
            writer.event(4_000, "run_end", NO_TRIAL, {"state": state, "reason": "why"})
    return path


def test_the_newest_come_first_and_pages_follow(tmp_path: Path) -> None:
    for hour in range(5):
        record(tmp_path / f"20261121-0{hour}0000-sweep.mcap")
    recordings = Recordings(tmp_path)
    page = recordings.lines(2, None, None)
    assert [run.run[9:11] for run in page.runs] == ["04", "03"]
    assert page.more
    rest = recordings.lines(10, page.runs[-1].run, None)
    assert [run.run[9:11] for run in rest.runs] == ["02", "01", "00"]
    assert not rest.more
    assert (rest.runs[0].trials_done, rest.runs[0].trials_total) == (1, 2)
    assert rest.runs[0].started_ns == 1_795_248_000_000_000_000


def test_line_has_specimen_and_given_values(tmp_path: Path) -> None:
    record(tmp_path / "20261121-080000-sweep.mcap")
    (line,) = Recordings(tmp_path).lines(10, None, None).runs
    assert (line.set, line.specimen) == ("floor=pvc, load=2 N", "W7")


def test_run_in_virtual_time_began_with_its_file(tmp_path: Path) -> None:
    path = tmp_path / "20261121-080000-sweep.mcap"
    record(path, started="2020-01-02T00:00:00+00:00", mode="simulated, virtual time")
    (line,) = Recordings(tmp_path).lines(10, None, None).runs
    assert line.started_ns == 1_795_248_000_000_000_000


def test_unreadable_recording_is_listed_with_its_problem(tmp_path: Path) -> None:
    (tmp_path / "torn.mcap").write_bytes(b"no recording")
    (tmp_path / "nowhere.mcap").symlink_to(tmp_path / "unmounted")
    (tmp_path / "folder.mcap").mkdir()
    record(tmp_path / "foreign.mcap", started="yesterday")
    recordings = Recordings(tmp_path)
    lines = recordings.lines(10, None, None).runs
    assert [line.run for line in lines] == [
        "torn.mcap", "nowhere.mcap", "foreign.mcap", "folder.mcap",
    ]  # fmt: skip
    for line in lines:
        assert line.state == "unreadable"
        assert line.problem
    assert recordings.view("foreign.mcap", None).line == lines[2]


@pytest.fixture
def searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Recordings:
    """Five recordings, two of them stopped, beside what cannot be read."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "runs"
    folder.mkdir()
    for hour in range(5):
        state = "stopped" if hour in (1, 3) else "complete"
        record(folder / f"20261121-0{hour}0000-sweep.mcap", state=state)
    (folder / "torn.mcap").write_bytes(b"no recording")
    (folder / "folder.mcap").mkdir()
    return Recordings(folder)


def test_condition_finds_recordings_page_by_page(searched: Recordings) -> None:
    page = searched.lines(1, None, None, "state == stopped")
    assert [run.run[9:11] for run in page.runs] == ["03"]
    assert page.more
    rest = searched.lines(10, page.runs[-1].run, None, "state == stopped")
    assert [run.run[9:11] for run in rest.runs] == ["01"]
    assert not rest.more
    assert searched.lines(10, None, None, "parameter.speed > 1").runs == ()
    assert len(searched.lines(10, None, None, " ").runs) == 7


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("stat == stopped", "stat"),
        ("state ==", "value"),
        ("duration > 5 kg", "kg"),
    ],
)
def test_wrong_condition_is_refused_with_its_mistake(
    searched: Recordings, where: str, message: str
) -> None:
    with pytest.raises(Refusal, match=message) as refused:
        searched.lines(10, None, None, where)
    assert refused.value.code == Code.BAD_REQUEST
    assert str(searched.folder) not in str(refused.value)  # clients must not see paths


def test_recording_just_begun_is_running_not_torn(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").touch()
    recordings = Recordings(tmp_path)
    (line,) = recordings.lines(10, None, "a.mcap").runs
    assert (line.state, line.problem) == ("running", None)
    assert recordings.view("a.mcap", "a.mcap").line == line


def test_file_is_fetched_in_pieces_that_complete_it(tmp_path: Path) -> None:
    path = tmp_path / "big.html"
    whole = bytes(range(256)) * 3000
    path.write_bytes(whole)
    record(tmp_path / "big.mcap")
    recordings = Recordings(tmp_path)
    got = b""
    while len(got) < len(whole):
        piece = recordings.piece(recordings.report("big.mcap"), len(got), MAX_PIECE_BYTES)
        told = as_json(piece)
        got += base64.b64decode(told["data"])
        assert told["size"] == len(whole)
        assert told["sha256"] == hashlib.sha256(whole).hexdigest()
    assert got == whole
    assert recordings.piece(path, len(whole), 10).data == b""
    with pytest.raises(Refusal, match="has 768000 bytes"):
        recordings.piece(path, len(whole) + 1, 10)


def test_growing_file_is_not_served_as_earlier_version(tmp_path: Path) -> None:
    path = tmp_path / "a.html"
    path.write_bytes(b"one")
    recordings = Recordings(tmp_path)
    before = recordings.piece(path, 0, 10).sha256
    path.write_bytes(b"other")
    assert recordings.piece(path, 0, 10).sha256 != before


@pytest.mark.parametrize(
    "name", ["../secret.mcap", "/etc/passwd", "a.txt", ".mcap", "missing.mcap"]
)
def test_only_recordings_can_be_requested(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.txt").write_text("secret")
    folder = tmp_path / "runs"
    folder.mkdir()
    record(tmp_path / "secret.mcap")
    with pytest.raises(Refusal, match="there is no recording"):
        Recordings(folder).path(name)


def test_a_run_without_an_end_is_offered(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", ended=False)
    record(tmp_path / "b.mcap", state="interrupted")
    record(tmp_path / "c.mcap", state="stopped")
    record(tmp_path / "d.mcap", ended=False, rig="another")
    offered = [interrupted(item) for item in Recordings(tmp_path).of("bench")]
    assert [item and (item.run, item.reason) for item in offered] == [
        None, ("b.mcap", "why"), ("a.mcap", "its recording has no end"),
    ]  # fmt: skip


def test_view_of_a_run_is_complete(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap")
    view = Recordings(tmp_path).view("a.mcap", None)
    assert view.line.state == "complete"
    assert view.details["recording"] == "a.mcap"
    assert str(tmp_path) not in str(view.details)


@pytest.mark.parametrize("kind", ["pipe", "link", "folder"])
@pytest.mark.parametrize("suffix", [".mcap", ".html"])
def test_file_that_is_not_regular_is_not_opened(tmp_path: Path, kind: str, suffix: str) -> None:
    """A pipe would block its reader, a link would publish a file from elsewhere."""
    runs, secret = tmp_path / "runs", tmp_path / "secret"
    runs.mkdir()
    secret.write_bytes(record(tmp_path / "other.mcap").read_bytes())
    odd = runs / f"odd{suffix}"
    {"pipe": os.mkfifo, "link": lambda path: path.symlink_to(secret), "folder": Path.mkdir}[kind](
        odd
    )
    if suffix == ".html":
        record(runs / "odd.mcap")
    recordings = Recordings(runs)
    (line,) = recordings.lines(10, None, None).runs
    told = line.problem or ""
    assert "a link, a pipe or a folder" in told if suffix == ".mcap" else not line.has_report
    assert str(tmp_path) not in told
    assert recordings.unreadable() == []
    with pytest.raises(Refusal, match="there is no re"):
        recordings.report("odd.mcap")
    with pytest.raises(Refusal, match=f"odd{suffix} cannot be read"):
        recordings.piece(odd, 0, 10)


@pytest.mark.parametrize(
    "name", ["a\nb.mcap", "a\x1b[2J.mcap", "a\u202e.mcap", "a b.mcap", ".mcap"]
)
def test_names_that_steer_a_terminal_are_left_out(tmp_path: Path, name: str) -> None:
    record(tmp_path / "a.mcap").rename(tmp_path / name)
    recordings = Recordings(tmp_path)
    assert recordings.lines(10, None, None).runs == ()
    assert recordings.of("bench") == []
    with pytest.raises(Refusal, match="there is no recording"):
        recordings.path(name)


def test_file_of_another_program_is_valid_or_damaged(tmp_path: Path) -> None:
    """It has no run: nothing is offered to be resumed, and nothing of it is repaired."""
    path = tmp_path / "others.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "another")
        number = writer.register_channel("/j", "json", 0)
        for t_ns in range(1, 2000):
            writer.add_message(number, t_ns, b'{"v": 1}', t_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    recordings = Recordings(tmp_path)
    (line,) = recordings.lines(10, None, None).runs
    assert (line.condition, line.state, line.problem) == ("valid", "no run", None)
    assert recordings.interrupted(path.name) is None
    data = path.read_bytes()[:-9]
    path.write_bytes(data)
    (line,) = recordings.lines(10, None, None).runs
    assert line.condition == "damaged"
    with pytest.raises(RecordingError, match="was written by 'another' and is damaged"):
        recover(path, others=False)
    assert path.read_bytes() == data
