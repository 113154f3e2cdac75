"""Takes the answers of clients to prompts (questions to the operator) of a run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rigd.engine.run.answers import AnswerRefused, check_answer
from rigd.model.errors import ProcedureError
from rigd.procedure.program import Answer, AnswerKind, Prompt
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.status import PromptView


@dataclass(frozen=True)
class _Put:
    """A question that waits for an answer."""

    id: int
    prompt: Prompt
    objection: str


class RemoteAnswers:
    """Waits for clients to answer the prompts of one run.

    ``ids`` gives every question a new number: an answer to a question that is closed, or was asked
    again, is refused. ``changed`` is called when a question opens or closes.
    """

    asks_again = True

    def __init__(self, ids: Iterator[int], changed: Callable[[], None]) -> None:
        self.by = "operator"  #: the client that gave the last answer
        self._ids = ids
        self._changed = changed
        self._condition = threading.Condition()
        self._put: _Put | None = None
        self._given: list[Answer] = []

    def can_answer(self, prompt: Prompt) -> bool:
        """Every prompt can be answered, by the client that holds the lease."""
        return True

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Wait for an answer.

        Raises:
            ProcedureError: the question was withdrawn.
        """
        with self._condition:
            mine = self._put = _Put(next(self._ids), prompt, objection)
            self._given.clear()
        self._changed()
        with self._condition:
            self._condition.wait_for(lambda: self._given or self._put is not mine)
            answered = self._put is mine
            given = self._given.pop() if answered else None
            if answered:
                self._put = None
        self._changed()
        if given is None:
            raise ProcedureError(f"prompt {prompt.name!r} was withdrawn")
        return given

    def withdraw(self) -> None:
        """Withdraw the open question, if there is one."""
        with self._condition:
            self._put = None
            self._condition.notify_all()

    def give(self, prompt_id: int, answer: Answer, who: str) -> None:
        """Answer the question of that id.

        Raises:
            Refusal: no such question waits, or it does not accept ``answer``.
        """
        with self._condition:
            put = self._put
            if put is None or put.id != prompt_id or self._given:
                raise Refusal(
                    Code.CONFLICT,
                    f"no prompt {prompt_id} waits for an answer",
                    hint="it was answered, put again or withdrawn: see the status",
                )
            _check(put.prompt, answer)
            self.by = who
            self._given.append(answer)
            self._condition.notify_all()

    @property
    def waits(self) -> bool:
        """Whether a question waits."""
        return self._put is not None

    def view(self) -> PromptView | None:
        """Return the question that waits."""
        put = self._put
        if put is None:
            return None
        prompt = put.prompt
        return PromptView(
            id=put.id,
            name=prompt.name,
            text=prompt.text,
            kind=prompt.kind.value,
            unit=prompt.unit,
            low=prompt.low,
            high=prompt.high,
            choices=prompt.choices,
            answer=prompt.answer,
            objection=put.objection,
        )


def _check(prompt: Prompt, answer: Answer) -> None:
    """Refuse an answer that the prompt does not accept, so that the client is informed at once.

    Raises:
        Refusal: the prompt does not accept it.
    """
    if prompt.kind is AnswerKind.CONFIRM and answer is False:
        return  # a person may decline: that ends the run as failed
    try:
        check_answer(prompt, answer)
    except AnswerRefused as error:
        raise Refusal(Code.REFUSED, error.message) from error
    except ProcedureError as error:
        raise Refusal(
            Code.REFUSED, f"prompt {prompt.name!r} wants yes or no (true or false), got {answer!r}"
        ) from error
