"""The audit log is only ever appended to, and reports when it could not be."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import pytest

from rigd.daemon.serve.upkeep.audit import AuditLog
from rigd.model.errors import RecordingError

START_NS = 1_790_000_000_000_000_000


def test_each_line_has_person_command_time_and_outcome(tmp_path: Path) -> None:
    log = AuditLog(tmp_path / "audit.jsonl", clock=lambda: START_NS)
    log.write("alice", "start", {"set": {"floor": "pvc"}}, role="operator")
    log.write("bob", "start", {}, "no_lease: alice has it")
    first, second = map(json.loads, log.path.read_text().splitlines())
    assert first == {
        "time": "2026-09-21T14:13:20.000+00:00",
        "who": "alice",
        "role": "operator",
        "what": "start",
        "args": {"set": {"floor": "pvc"}},
        "result": "done",
    }
    assert second["result"] == "no_lease: alice has it"
    assert log.path.stat().st_mode & 0o007 == 0


def test_existing_lines_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    for who in ("alice", "bob"):
        AuditLog(path).write(who, "pause", {})
    assert [json.loads(line)["who"] for line in path.read_text().splitlines()] == ["alice", "bob"]


def test_lines_of_several_threads_do_not_mix(tmp_path: Path) -> None:
    log = AuditLog(tmp_path / "audit.jsonl")

    def write() -> None:
        for _ in range(20):
            log.write("a" * 500, "stop", {})

    work = [threading.Thread(target=write) for _ in range(4)]
    for item in work:
        item.start()
    for item in work:
        item.join()
    lines = [json.loads(line) for line in log.path.read_text().splitlines()]
    assert len(lines) == 80


def test_disk_error_is_reported_until_the_disk_recovers(tmp_path: Path) -> None:
    log = AuditLog(tmp_path / "gone" / "audit.jsonl")
    log.write("alice", "pause", {})
    assert "cannot be written" in log.broken
    with pytest.raises(RecordingError, match="this command could not be logged"):
        log.check()
    (tmp_path / "gone").mkdir()
    log.check()
    assert not log.broken
    missing, tried = map(json.loads, log.path.read_text().splitlines())
    assert (missing["args"], missing["result"]) == ({"missing": 2}, "kept again")
    assert tried["result"] == "tried again"


def test_line_torn_by_full_disk_spoils_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, write = AuditLog(tmp_path / "audit.jsonl"), os.write
    log.write("alice", "pause", {})
    monkeypatch.setattr(os, "write", lambda fd, data: write(fd, data[:20]))
    log.write("alice", "resume", {})
    assert "No space left" in log.broken
    monkeypatch.undo()
    log.write("bob", "pause", {})
    whole, torn, missing, last = log.path.read_text().splitlines()
    assert len(torn) == 20
    assert [json.loads(item)["who"] for item in (whole, missing, last)] == ["alice", "rigd", "bob"]
