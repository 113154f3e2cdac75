"""Notices are lines, with any text of a client."""

from __future__ import annotations

import logging

import pytest

from rigd.daemon.serve.upkeep.notices import KEPT, Notices


def test_client_text_cannot_break_lines_or_steer_terminal(
    caplog: pytest.LogCaptureFixture,
) -> None:
    notices = Notices(lambda: None)
    with caplog.at_level(logging.INFO):
        notices.note("stop by eve: \x1b[2J\n12:00:00 all is well" + "x" * 5000)
    [notice] = notices.views()
    assert notice.text.startswith("stop by eve:  [2J 12:00:00 all is well")
    assert len(notice.text) == 1000
    assert caplog.records[0].getMessage() == notice.text


def test_newest_notices_are_kept_in_order() -> None:
    news: list[int] = []
    notices = Notices(lambda: news.append(1), clock=lambda: len(news))
    for number in range(KEPT + 5):
        notices.note(str(number))
    assert [view.text for view in notices.views()] == [str(n) for n in range(5, KEPT + 5)]
    assert len(news) == KEPT + 5
