"""Codes open one session each; sessions end; who has gone is known."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from rigd.panel.rates import MOST_ADDRESSES, Bucket, BucketByAddress
from rigd.panel.session_store import SessionStore
from rigd.panel.sessions import CODE_S, IDLE_S, MOST_CODES, MOST_SESSIONS, Sessions


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_a_code_opens_one_session_of_its_role() -> None:
    sessions = Sessions()
    code = sessions.invite("observer")
    opened = sessions.redeem(code, "Ada")
    assert opened is not None
    key, session = opened
    assert (session.name, session.role) == ("Ada", "observer")
    assert sessions.find(key) is session
    assert sessions.redeem(code, "Bob") is None
    assert key not in str(vars(sessions)), "kept as a hash only"


def test_codes_age_and_are_bounded() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    old = sessions.invite("operator")
    clock.now += CODE_S + 1
    assert sessions.redeem(old, "Ada") is None
    first = sessions.invite("operator")
    for _ in range(MOST_CODES):
        last = sessions.invite("operator")
    assert sessions.redeem(first, "Ada") is None
    assert sessions.redeem(last, "Ada") is not None


def test_a_session_ends_when_idle_but_not_while_a_page_is_open() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    opened = sessions.redeem(sessions.invite("operator"), "Ada")
    assert opened is not None
    key, session = opened
    sessions.open_page(session)
    clock.now += 2 * IDLE_S
    assert sessions.find(key) is session
    sessions.close_page(session)
    clock.now += IDLE_S + 1
    assert sessions.find(key) is None


def test_the_longest_unused_makes_room() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    keys = []
    for n in range(MOST_SESSIONS + 1):
        clock.now += 1
        opened = sessions.redeem(sessions.invite("operator"), f"user {n}")
        assert opened is not None
        keys.append(opened[0])
    assert sessions.find(keys[0]) is None
    assert sessions.find(keys[1]) is not None


def test_who_watches_and_invites_without_end_takes_nothing_from_who_commands() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    printed = sessions.invite("operator", IDLE_S)
    opened = sessions.redeem(sessions.invite("operator"), "Ada")
    assert opened is not None
    sessions.open_page(opened[1])
    for n in range(MOST_SESSIONS + MOST_CODES):
        clock.now += 1
        watching = sessions.redeem(sessions.invite("observer"), f"user {n}")
        assert watching is not None
        sessions.open_page(watching[1])
        sessions.invite("observer")
    assert not opened[1].over.is_set()
    assert sessions.find(opened[0]) is opened[1]
    assert sessions.redeem(printed, "Bob") is not None


def test_a_page_that_is_open_is_kept_before_one_that_was_closed() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    opened = [sessions.redeem(sessions.invite("operator"), f"user {n}") for n in range(2)]
    assert opened[0] is not None and opened[1] is not None
    sessions.open_page(opened[0][1])
    clock.now += 1
    assert sessions.find(opened[1][0]) is not None
    for n in range(MOST_SESSIONS - 1):
        assert sessions.redeem(sessions.invite("operator"), f"user {n}") is not None
    assert sessions.find(opened[1][0]) is None
    assert sessions.find(opened[0][0]) is not None


def test_who_has_no_page_open_is_gone_after_a_while() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    opened = sessions.redeem(sessions.invite("operator"), "Ada")
    assert opened is not None
    key, session = opened
    sessions.open_page(session)
    sessions.open_page(session)
    sessions.close_page(session)
    clock.now += 60
    assert not sessions.is_gone(session, grace_s=4)
    sessions.close_page(session)
    clock.now += 3
    assert not sessions.is_gone(session, grace_s=4)
    clock.now += 2
    assert sessions.is_gone(session, grace_s=4)
    sessions.open_page(session)
    assert not sessions.is_gone(session, grace_s=4)
    sessions.end(key)
    assert sessions.is_gone(session, grace_s=4)


def test_a_bucket_lets_a_burst_pass_then_a_rate() -> None:
    clock = Clock()
    bucket = Bucket(per_s=2.0, burst=5.0, now=clock)
    assert sum(bucket.take() for _ in range(50)) == 5
    clock.now += 3.0
    assert sum(bucket.take() for _ in range(50)) == 5  # no more than the burst
    clock.now += 1.0
    assert sum(bucket.take() for _ in range(50)) == 2


def test_one_address_that_asks_too_often_keeps_no_other_out() -> None:
    buckets = BucketByAddress(per_s=1e-9, burst=2.0)
    assert [buckets.take("10.0.0.1") for _ in range(3)] == [True, True, False]
    assert buckets.take("10.0.0.2")
    for number in range(MOST_ADDRESSES):  # the least recent is forgotten, so memory is bounded
        buckets.take(f"other {number}")
    assert buckets.take("10.0.0.1")


def test_who_is_logged_in_stays_so_when_the_panel_starts_anew(tmp_path: Path) -> None:
    clock, wall = Clock(), Clock()
    book = SessionStore(tmp_path / "panel.json", wall)
    before = Sessions(clock, book)
    opened = [before.redeem(before.invite("operator"), name) for name in ("Ada", "Bob", "Eve")]
    (ada, session), (bob, _), (eve, _) = (item for item in opened if item is not None)
    before.open_page(session)
    before.end(eve)
    wall.now += IDLE_S + 1  # Ada's page was open all the time, Bob's tab is closed since yesterday
    after = Sessions(clock, book)
    found = after.find(ada)
    assert found is not None
    assert (found.name, found.role, found.number) == ("Ada", "operator", session.number)
    assert after.find(bob) is None
    assert after.find(eve) is None
    new = after.redeem(after.invite("observer"), "Dan")
    assert new is not None
    assert new[1].number > session.number


def test_the_book_lets_nobody_in(tmp_path: Path) -> None:
    path = tmp_path / "panel.json"
    sessions = Sessions(book=SessionStore(path))
    opened = sessions.redeem(sessions.invite("operator"), "Ada")
    assert opened is not None
    assert opened[0] not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


@pytest.mark.parametrize("text", ["", "[]", '{"written_unix_s": 1, "sessions": [{"name": "Ada"}]}'])
def test_a_book_that_is_spoilt_costs_new_links_only(
    tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "panel.json"
    path.write_text(text)
    sessions = Sessions(book=SessionStore(path))
    assert "each screen needs a new link" in caplog.text
    assert sessions.redeem(sessions.invite("operator"), "Ada") is not None
    assert len(SessionStore(path).read()[1]) == 1
