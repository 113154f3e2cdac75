"""What is refused is counted each time, and logged now and then."""

from __future__ import annotations

import logging

import pytest

from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.status import RefusedCounts
from rigd.remote.server.refusal_log import Refused, TooManyQuestions


def test_flood_is_counted_fully_and_logged_each_second(
    caplog: pytest.LogCaptureFixture,
) -> None:
    now_ns = 0
    refused = Refused(clock=lambda: now_ns)
    with caplog.at_level(logging.WARNING):
        for _ in range(1000):
            refused.count("rigd/a/cmd/eve/start", Refusal(Code.BAD_REQUEST, "no"))
        now_ns = 1_000_000_000
        refused.count("rigd/a/cmd/eve/start", Refusal(Code.TOO_LARGE, "no"))
    assert refused.counts() == RefusedCounts(malformed=1000, oversized=1)
    assert len(caplog.records) == 2
    assert "999 more since" in caplog.text


def test_normal_refusal_is_neither_counted_nor_logged(caplog: pytest.LogCaptureFixture) -> None:
    refused = Refused()
    for code in (Code.NO_LEASE, Code.LEASE_HELD, Code.CONFLICT, Code.REFUSED, Code.BUSY):
        refused.count("rigd/a/cmd/bob/start", Refusal(code, "no"))
    assert refused.counts() == RefusedCounts()
    assert caplog.records == []


def test_text_of_client_cannot_break_log_lines(
    caplog: pytest.LogCaptureFixture,
) -> None:
    Refused().count("a\nb" * 200, Refusal(Code.BAD_REQUEST, "args.a\nb: unknown" * 200))
    assert "\n" not in caplog.records[0].getMessage()
    assert len(caplog.records[0].getMessage()) < 700


def test_client_asking_too_much_is_counted_and_named(caplog: pytest.LogCaptureFixture) -> None:
    refused = Refused()
    for _ in range(3):
        refused.count("rigd/a/ask/x/latest", TooManyQuestions("mallory"))
    assert refused.counts() == RefusedCounts(too_many=3)
    (record,) = caplog.records
    assert "mallory asks more than 100 questions a second" in record.getMessage()
