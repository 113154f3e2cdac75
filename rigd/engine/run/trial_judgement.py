"""Judges each trial once it has ended, and does what the procedure says about a bad one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from rigd.engine.play.control import Control
from rigd.engine.play.player import Outcome
from rigd.engine.run.asking import Asking
from rigd.engine.run.host import Host
from rigd.model.errors import RigdError
from rigd.model.severity import Severity
from rigd.procedure.program import AnswerKind, Prompt, TrialCheck

#: The prompt that asks whether to go on, and its answers.
PROMPT: Final = "trial_check"
GO_ON: Final = "go on"
END: Final = "end"


@dataclass(frozen=True)
class TrialJudge:
    """Calls ``check`` with the number of a trial; it returns why the trial cannot be used.

    ``give_up`` ends a check that nobody waits for any more.
    """

    check: Callable[[int], Sequence[str]]
    action: TrialCheck
    give_up: Callable[[], None] = lambda: None

    def judge(self, number: int, host: Host, asking: Asking, control: Control) -> Outcome | None:
        """Return why no trial follows, or None.

        The rig is at rest meanwhile. A check that fails is stated and ends nothing.
        """
        reasons: list[str] = []
        failures: list[str] = []

        def check() -> None:
            try:
                reasons.extend(self.check(number))
            except RigdError as error:
                failures.append(error.message)

        host.flush()
        stopped = host.ask(check)
        if stopped is not None:
            self.give_up()
            return stopped
        if failures:
            control.notices.append(f"trial {number} could not be checked: {failures[0]}")
        if failures or not reasons:
            return None
        told = " ".join(reasons)
        host.event("trial_checked", {"number": number, "reasons": reasons})
        control.notices.append(f"trial {number} cannot be used: {told}")
        unusable = Outcome(Severity.FAIL, f"trial {number} cannot be used: {told}")
        if self.action is TrialCheck.WARN:
            return None
        if self.action is TrialCheck.END:
            return unusable
        return asking.ask(_question(number, told)) or (
            None if asking.given.get(PROMPT) == GO_ON else unusable
        )


def _question(number: int, told: str) -> Prompt:
    """Return the question whether to go on; without an operator the answer is no."""
    return Prompt(
        PROMPT,
        f"Trial {number} cannot be used: {told} Go on?",
        kind=AnswerKind.CHOICE,
        choices=(END, GO_ON),
        answer=END,
    )
