"""Asks the operator a question until the answer is valid and the channels of the rig confirm it.

If the procedure itself gives an answer and that answer is refused, the run ends as failed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from rigd.engine.play.player import Outcome
from rigd.engine.run.answers import AnswerRefused, Answers, check_answer
from rigd.engine.run.host import Host
from rigd.model.errors import ProcedureError
from rigd.model.severity import Severity
from rigd.procedure.program import Answer, AnswerKind, Prompt
from rigd.procedure.steps.agreement import check_of, objection_to

#: ``change(quantity, value)``: changes the plant of a simulated rig after an answer.
ChangePlant = Callable[[str, float | str], None]


@dataclass(frozen=True)
class Asking:
    """Asks prompts of ``answers`` on the rig behind ``host``, which stays at rest meanwhile.

    ``change`` is None for a real rig. ``set_up`` gets the last answer for each quantity that
    prompts set up, ``given`` the last answer to each prompt, by name. An operator whose answer is
    refused gets the reason and is asked again; if the procedure's own answer is refused, the run
    ends as failed.
    """

    host: Host
    answers: Answers
    change: ChangePlant | None = None
    set_up: dict[str, Answer] = field(default_factory=dict)
    given: dict[str, Answer] = field(default_factory=dict)

    def ask(self, prompt: Prompt) -> Outcome | None:
        """Return when the rig may move on: None, or the outcome that ends the program."""
        objection = ""
        while True:
            question = {"name": prompt.name, "text": prompt.text}
            self.host.event("prompt", question | ({"objection": objection} if objection else {}))
            given: list[Answer] = []
            try:
                outcome = self.host.ask(partial(self._ask, prompt, objection, given))
                if outcome is not None:
                    self.answers.withdraw()
                    return outcome
                return self._take(prompt, given[0])
            except AnswerRefused as refused:
                if not self.answers.asks_again:
                    return Outcome(Severity.FAIL, refused.message)
                objection = refused.message
            except ProcedureError as error:
                return Outcome(Severity.FAIL, error.message)

    def _ask(self, prompt: Prompt, objection: str, given: list[Answer]) -> None:
        given.append(self.answers.answer(prompt, objection))

    def _take(self, prompt: Prompt, given: Answer) -> Outcome | None:
        """Record the answer, change the plant of a simulated rig, and check that the rig shows it.

        Raises:
            AnswerRefused: another answer is needed.
            ProcedureError: the operator declined.
        """
        answer = check_answer(prompt, given)
        self.host.event(
            "answer",
            {
                "name": prompt.name,
                "answer": answer,
                "planned": prompt.answer,
                "unit": prompt.unit if prompt.kind is AnswerKind.NUMBER else "",
                "changes": prompt.changes or "",
                "by": self.answers.by,
            },
        )
        self.given[prompt.name] = answer
        if prompt.changes is not None:
            self.set_up[prompt.changes] = answer
        if prompt.changes is not None and self.change is not None:
            try:
                self.change(prompt.changes, answer)
            except ValueError as error:
                raise AnswerRefused(f"prompt {prompt.name!r}: {error}") from error
        return self._look(prompt, answer)

    def _look(self, prompt: Prompt, answer: Answer) -> Outcome | None:
        check = check_of(prompt, answer)
        if check is None:
            return None
        outcome = self.host.play(check)
        agreed = outcome.severity is Severity.DONE
        # A program that commands nothing can only fail by running out of time.
        if not agreed and outcome.severity is not Severity.FAIL:
            return outcome
        self.host.event(
            "answer_checked",
            {"name": prompt.name, "answer": answer, "agreed": agreed, "shown": outcome.last_values},
        )
        if not agreed:
            raise AnswerRefused(objection_to(prompt, answer, outcome.last_values))
        return None
