"""The daemon's log, for people and for programs."""

from __future__ import annotations

import io
import json
import logging

import pytest

from rigd.daemon.serve.upkeep.logs import logging_to

LOG = logging.getLogger("rigd.test")


def log_some(stream: io.StringIO, *, as_json: bool | None) -> list[str]:
    with logging_to(stream, as_json=as_json):
        LOG.info("began %s", "quick")
        try:
            raise ValueError("wrong")
        except ValueError:
            LOG.exception("it failed")
    LOG.warning("nobody listens any more")
    return stream.getvalue().splitlines()


@pytest.mark.parametrize("as_json", [True, None])
def test_log_without_terminal_has_json_object_per_record(as_json: bool | None) -> None:
    first, second = map(json.loads, log_some(io.StringIO(), as_json=as_json))
    assert (first["level"], first["logger"], first["message"]) == (
        "info", "rigd.test", "began quick",
    )  # fmt: skip
    assert first["time"].endswith("+00:00")
    assert (second["level"], second["message"].splitlines()[0]) == ("error", "it failed")
    assert "ValueError: wrong" in json.dumps(second)


def test_log_at_a_terminal_has_text_lines() -> None:
    lines = log_some(io.StringIO(), as_json=False)
    assert lines[0].endswith(" began quick")
    assert " error: it failed" in lines[1]
    assert lines[-1] == "ValueError: wrong"
