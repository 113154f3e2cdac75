"""Reads and checks the answers to the prompts (questions to the operator) of a procedure.

The operator or the procedure file gives an answer.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Protocol

from rigd.model.errors import ProcedureError
from rigd.model.limits import rounded_to
from rigd.model.units import format_quantity, parse_quantity, parse_unit
from rigd.procedure.program import Answer, AnswerKind, Prompt

#: The name of a prompt, and an answer that was given to it.
Given = tuple[str, Answer]


class AnswerRefused(ProcedureError):
    """The answer was refused; the operator may give another answer. The message is the reason."""


class Answers(Protocol):
    """A source of answers: the operator, or the procedure file itself."""

    by: str  #: recorded beside each answer: ``operator`` or ``procedure``

    @property
    def asks_again(self) -> bool:
        """Whether it can give another answer if an answer was refused."""
        ...

    def can_answer(self, prompt: Prompt) -> bool:
        """Return whether :meth:`answer` can return an answer."""
        ...

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Return the answer; may wait for a person.

        ``objection`` is the reason why the previous answer was refused, if it was.
        """
        ...

    def withdraw(self) -> None:
        """Withdraw the question that waits: something else has ended the program.

        :meth:`answer` may return at any later time; its result is ignored.
        """
        ...


class OwnAnswers:
    """Gives the answers that the procedure file contains: in simulation, and with ``--yes``."""

    by = "procedure"
    asks_again = False

    def can_answer(self, prompt: Prompt) -> bool:
        """Return whether the prompt has an answer; a confirmation needs none."""
        return prompt.answer is not None or prompt.kind is AnswerKind.CONFIRM

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Return the procedure's own answer."""
        if prompt.answer is not None:
            return prompt.answer
        if prompt.kind is AnswerKind.CONFIRM:
            return True
        raise ProcedureError(f"prompt {prompt.name!r} has no answer of its own")

    def withdraw(self) -> None:
        """Do nothing: no question ever waits."""


class GivenBefore:
    """Gives the answers of a recorded trial again, in their order, those refused included."""

    by = "recording"

    def __init__(self, given: Sequence[Given]) -> None:
        self._given = deque(given)

    @property
    def asks_again(self) -> bool:
        """Whether a further answer is recorded."""
        return bool(self._given)

    def can_answer(self, prompt: Prompt) -> bool:
        """Return whether there is an answer: a recorded one, or the procedure's own."""
        return bool(self._given) or OwnAnswers().can_answer(prompt)

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Return the next recorded answer if it is one to this prompt, else the procedure's own."""
        if self._given and self._given[0][0] == prompt.name:
            return self._given.popleft()[1]
        return OwnAnswers().answer(prompt)

    def withdraw(self) -> None:
        """Do nothing: no question ever waits."""


def read_answer(prompt: Prompt, text: str) -> Answer:
    """Return a typed text as the prompt's type, numbers in SI.

    Raises:
        ValueError: the text cannot be parsed as an answer to this prompt.
    """
    match prompt.kind:
        case AnswerKind.CONFIRM:
            if text.lower() not in ("y", "yes", "n", "no"):
                raise ValueError("please answer yes or no")
            return text.lower().startswith("y")
        case AnswerKind.NUMBER:
            quantity = parse_quantity(text)
            if not quantity.unit.same_kind(parse_unit(prompt.unit)):
                unitless = quantity.unit.same_kind(parse_unit("1"))
                such = f"'{text} {prompt.unit}'" if unitless else f"a quantity in {prompt.unit}"
                raise ValueError(f"{text!r} is not in {prompt.unit}: write {such}")
            return quantity.value
        case AnswerKind.CHOICE:
            if text not in prompt.choices:
                raise ValueError(f"{text!r} is not one of {', '.join(prompt.choices)}")
            return text
        case AnswerKind.TEXT:
            return text


def check_answer(prompt: Prompt, answer: Answer) -> Answer:
    """Return ``answer`` if the prompt accepts it.

    Raises:
        AnswerRefused: out of bounds, not one of the choices, or of the wrong type.
        ProcedureError: the operator declined.
    """
    match prompt.kind:
        case AnswerKind.CONFIRM:
            if answer is not True:
                raise ProcedureError(f"prompt {prompt.name!r} was declined")
        case AnswerKind.NUMBER:
            if isinstance(answer, bool) or not isinstance(answer, int | float):
                raise AnswerRefused(
                    f"prompt {prompt.name!r} expects a number in {prompt.unit}, got {answer!r}"
                )
            return _inside(prompt, float(answer))
        case AnswerKind.CHOICE:
            if answer not in prompt.choices:
                raise AnswerRefused(
                    f"prompt {prompt.name!r}: {answer!r} is not one of {', '.join(prompt.choices)}"
                )
        case AnswerKind.TEXT:
            if not isinstance(answer, str):
                raise AnswerRefused(f"prompt {prompt.name!r} expects text, got {answer!r}")
    return answer


def _inside(prompt: Prompt, value: float) -> float:
    """Return ``value``, at a bound of ``prompt`` if rounding has brought it beyond."""
    low = -math.inf if prompt.low is None else prompt.low
    high = math.inf if prompt.high is None else prompt.high
    value = rounded_to(low, value, high)
    if low <= value <= high:  # NaN is not
        return value
    bounds = [
        "" if item is None else format_quantity(item, prompt.unit)
        for item in (prompt.low, prompt.high)
    ]
    raise AnswerRefused(
        f"prompt {prompt.name!r}: {format_quantity(value, prompt.unit)} is outside "
        f"{bounds[0]} .. {bounds[1]}"
    )
