"""A trial is judged once it has ended: what a procedure makes of one that cannot be used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from rigd.engine.play.control import Control
from rigd.engine.play.player import Outcome
from rigd.engine.run.answers import Answers, OwnAnswers
from rigd.engine.run.asking import Asking
from rigd.engine.run.host import Host
from rigd.engine.run.trial_judgement import END, GO_ON, TrialJudge
from rigd.model.errors import DataError
from rigd.model.severity import Severity
from rigd.procedure.program import Answer, Prompt, TrialCheck

SWAPPED = "gauge a and b are swapped."


@dataclass
class RestingHost:
    """A rig at rest: questions are put at once."""

    events: list[tuple[str, Mapping[str, object]]] = field(default_factory=list)
    flushed: int = 0
    stopped: Outcome | None = None

    def flush(self) -> None:
        self.flushed += 1

    def ask(self, question: Callable[[], None]) -> Outcome | None:
        question()
        return self.stopped

    def event(self, kind: str, data: Mapping[str, object]) -> None:
        self.events.append((kind, data))


@dataclass
class Operator:
    """Gives one answer to every question."""

    says: Answer
    by: str = "operator"
    asks_again: bool = True

    def can_answer(self, prompt: Prompt) -> bool:
        return True

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        return self.says

    def withdraw(self) -> None:
        pass


def judged(
    action: TrialCheck, reasons: Sequence[str] = (SWAPPED,), answers: Any = None,
    host: RestingHost | None = None, give_up: Callable[[], None] = lambda: None,
) -> tuple[Outcome | None, RestingHost, Control]:  # fmt: skip
    """Return the outcome of trial 3, its rig, and what the operator reads."""
    rig, control = host or RestingHost(), Control()

    def check(number: int) -> Sequence[str]:
        assert number == 3 and rig.flushed == 1
        return reasons

    judge = TrialJudge(check, action, give_up)
    as_host = cast(Host, rig)
    asking = Asking(as_host, cast(Answers, answers or OwnAnswers()))
    return judge.judge(3, as_host, asking, control), rig, control


def test_good_trial_is_followed_in_silence() -> None:
    outcome, rig, control = judged(TrialCheck.END, ())
    assert outcome is None and rig.events == [] and not control.notices


def test_bad_trial_is_stated_and_run_continues() -> None:
    outcome, rig, control = judged(TrialCheck.WARN)
    assert outcome is None
    assert rig.events == [("trial_checked", {"number": 3, "reasons": [SWAPPED]})]
    assert control.notices[0] == f"trial 3 cannot be used: {SWAPPED}"


def test_bad_trial_ends_run_if_asked_for() -> None:
    outcome, _, _ = judged(TrialCheck.END)
    assert outcome is not None and outcome.severity is Severity.FAIL
    assert SWAPPED in outcome.reason


@pytest.mark.parametrize(("answer", "ends"), [(GO_ON, False), (END, True)])
def test_operator_decides_whether_run_continues(answer: str, ends: bool) -> None:
    outcome, rig, _ = judged(TrialCheck.ASK, answers=Operator(answer))
    assert (outcome is not None) is ends
    assert [kind for kind, _ in rig.events] == ["trial_checked", "prompt", "answer"]


def test_question_without_an_operator_ends_the_run() -> None:
    outcome, _, _ = judged(TrialCheck.ASK)
    assert outcome is not None and outcome.severity is Severity.FAIL


def test_stop_during_check_ends_the_run() -> None:
    stop = Outcome(Severity.STOP, "stopped by hand")
    ended: list[bool] = []
    outcome, rig, _ = judged(
        TrialCheck.WARN, host=RestingHost(stopped=stop), give_up=lambda: ended.append(True)
    )
    assert outcome is stop and rig.events == []
    assert ended == [True]


def test_check_that_fails_is_stated_and_ends_nothing() -> None:
    def broken(_: int) -> Sequence[str]:
        raise DataError("the recording has no scale")

    rig, control = RestingHost(), Control()
    judge, host = TrialJudge(broken, TrialCheck.END), cast(Host, rig)
    assert judge.judge(3, host, Asking(host, OwnAnswers()), control) is None
    assert "could not be checked: the recording has no scale" in control.notices[0]
