"""Codes open one session each; sessions end; users have names of their own."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from rigd.panel.login.session_store import SessionStore
from rigd.panel.login.sessions import CODE_S, IDLE_S, MOST_CODES, MOST_SESSIONS, Sessions
from rigd.panel.messages import Role
from rigd.remote.request_rates import MOST_CLIENTS, Bucket, BucketByClient


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_invitation_code_opens_one_session_of_role() -> None:
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


def test_session_ends_when_idle_unless_page_is_open() -> None:
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


def test_full_session_table_drops_longest_unused() -> None:
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


def test_endless_observer_invitations_take_nothing_from_operators() -> None:
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


def test_open_page_is_kept_before_a_closed_one() -> None:
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


def test_user_has_page_until_last_is_closed() -> None:
    sessions = Sessions()
    opened = sessions.redeem(sessions.invite("operator"), "Ada")
    assert opened is not None
    key, session = opened
    assert not sessions.may_hold_lease("Ada")
    sessions.open_page(session)
    sessions.open_page(session)
    sessions.close_page(session)
    assert sessions.may_hold_lease("Ada") and not sessions.may_hold_lease("Bob")
    sessions.end(key)
    assert not sessions.may_hold_lease("Ada")


def test_observer_with_operators_name_keeps_no_lease() -> None:
    sessions = Sessions()
    cases: tuple[tuple[Role, bool], ...] = (("operator", True), ("observer", False))
    for role, may in cases:
        opened = sessions.redeem(sessions.invite(role), "Ada")
        assert opened is not None
        key, session = opened
        sessions.open_page(session)
        assert (session.name, sessions.may_hold_lease("Ada")) == ("Ada", may)
        sessions.end(key)


def test_second_user_of_a_name_gets_a_number() -> None:
    sessions = Sessions()
    opened = [sessions.redeem(sessions.invite("operator"), "Ada") for _ in range(3)]
    assert [item[1].name for item in opened if item] == ["Ada", "Ada (2)", "Ada (3)"]


def test_bucket_permits_a_burst_then_the_rate() -> None:
    clock = Clock()
    bucket = Bucket(per_s=2.0, burst=5.0, now=clock)
    assert sum(bucket.take() for _ in range(50)) == 5
    clock.now += 3.0
    assert sum(bucket.take() for _ in range(50)) == 5  # no more than the burst
    clock.now += 1.0
    assert sum(bucket.take() for _ in range(50)) == 2


def test_address_asking_too_often_blocks_no_other() -> None:
    buckets = BucketByClient(per_s=1e-9, burst=2.0)
    assert [buckets.take("10.0.0.1") for _ in range(3)] == [True, True, False]
    assert buckets.take("10.0.0.2")
    for number in range(MOST_CLIENTS):  # the least recent is forgotten, so memory is bounded
        buckets.take(f"other {number}")
    assert buckets.take("10.0.0.1")


def test_login_survives_a_restart_of_the_panel(tmp_path: Path) -> None:
    clock, wall = Clock(), Clock()
    store = SessionStore(tmp_path / "panel.json", wall)
    before = Sessions(clock, store)
    opened = [before.redeem(before.invite("operator"), name) for name in ("Ada", "Bob", "Eve")]
    (ada, session), (bob, _), (eve, _) = (item for item in opened if item is not None)
    before.open_page(session)
    before.end(eve)
    wall.now += IDLE_S + 1  # Ada's page was open all the time, Bob's tab is closed since yesterday
    after = Sessions(clock, store)
    found = after.find(ada)
    assert found is not None
    assert (found.name, found.role) == ("Ada", "operator")
    assert after.find(bob) is None
    assert after.find(eve) is None


def test_stored_sessions_admit_no_browser(tmp_path: Path) -> None:
    path = tmp_path / "panel.json"
    sessions = Sessions(store=SessionStore(path))
    opened = sessions.redeem(sessions.invite("operator"), "Ada")
    assert opened is not None
    assert opened[0] not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


@pytest.mark.parametrize("text", ["", "[]", '{"written_unix_s": 1, "sessions": [{"name": "Ada"}]}'])
def test_spoilt_session_file_costs_new_links_only(
    tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "panel.json"
    path.write_text(text)
    sessions = Sessions(store=SessionStore(path))
    assert "each screen needs a new link" in caplog.text
    assert sessions.redeem(sessions.invite("operator"), "Ada") is not None
    assert len(SessionStore(path).read()[1]) == 1
