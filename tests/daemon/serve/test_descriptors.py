"""A daemon without free descriptors reports that it cannot recover, but never during a run."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest
from support.served_axis import LONG, ServedAxis

from rigd.daemon.serve import descriptors
from rigd.remote.server import Admission


class NothingToEnd:
    """An admission whose connections all belong to clients."""

    pauses = waiting_ended = 0

    def end_unauthenticated(self) -> int:
        return 0

    def refuse_waiting(self) -> int:
        return 0


@pytest.fixture
def full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedAxis]:
    """Return a service whose descriptors are all in use, and cannot be freed."""
    monkeypatch.setattr(descriptors, "HELPLESS_S", 0.0)
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)
    with ServedAxis(tmp_path) as served:
        served.descriptors.limit = 1
        admission = cast("Admission", NothingToEnd())
        with served.descriptors.watched(admission, served.notices.note):
            yield served


def test_daemon_without_free_descriptor_reports_it(full: ServedAxis) -> None:
    told = "all 1 descriptors have been in use for 0 s"
    full.until(lambda _: full.service.helpless == told)
    warning = full.until(lambda status: status.notices).notices[-1].text
    assert warning.endswith("of 1 descriptors are in use: unauthenticated connections are ended")
    full.descriptors.limit = 1_000_000
    full.until(lambda _: full.service.helpless == "")


def test_daemon_without_free_descriptor_continues_its_run(full: ServedAxis) -> None:
    full.until(lambda _: full.service.helpless)
    full.start(LONG)
    full.until(lambda status: status.step == "go")
    assert full.service.helpless == ""
    full.stop("alice", "stop")
    full.until_idle()
    assert full.service.helpless
