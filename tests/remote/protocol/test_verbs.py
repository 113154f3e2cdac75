"""The table of verbs gives the role of each verb."""

from __future__ import annotations

import pytest

from rigd.remote.protocol import VERBS, Code, Kind, Refusal, Role, check_role, find_verb


def allowed(role: Role, kind: Kind) -> set[str]:
    return {name for name, verb in VERBS[kind].items() if role.includes(verb.rule.role)}


@pytest.mark.parametrize("role", Role)
def test_every_role_may_ask_and_stop(role: Role) -> None:
    for kind in (Kind.ASK, Kind.STOP):
        assert allowed(role, kind) == set(VERBS[kind])
        assert not any(verb.rule.needs_lease for verb in VERBS[kind].values())


def test_observer_may_not_command() -> None:
    assert allowed(Role.OBSERVER, Kind.COMMAND) == set()


def test_only_maintainer_acts_on_devices_and_seizes_lease() -> None:
    beyond = allowed(Role.MAINTAINER, Kind.COMMAND) - allowed(Role.OPERATOR, Kind.COMMAND)
    assert beyond == {"act", "lease_seize"}


def test_verbs_that_move_need_the_lease() -> None:
    free = {name for name, verb in VERBS[Kind.COMMAND].items() if not verb.rule.needs_lease}
    assert free == {
        "lease_take", "lease_renew", "lease_release", "lease_request", "lease_give", "lease_seize",
        "draw", "dry_run",
    }  # fmt: skip


def test_a_role_that_does_not_reach_is_refused() -> None:
    with pytest.raises(Refusal, match=r"operator, .*observer") as caught:
        check_role(Role.OBSERVER, find_verb(Kind.COMMAND, "start"))
    assert caught.value.code is Code.FORBIDDEN


def test_a_verb_of_another_kind_is_unknown() -> None:
    with pytest.raises(Refusal) as caught:
        find_verb(Kind.ASK, "start")
    assert caught.value.code is Code.UNKNOWN_VERB
