"""Answers to the prompts of a procedure: their sources and their checks."""

from __future__ import annotations

from typing import Protocol

from rigd.model.errors import ProcedureError
from rigd.model.units import format_quantity, parse_quantity, parse_unit
from rigd.procedure.program import Answer, AnswerKind, Prompt


class AnswerRefused(ProcedureError):
    """An answer that cannot be, where another one may: the message says what speaks against it."""


class Answers(Protocol):
    """A source of answers: the operator, or the procedure file itself."""

    by: str  #: recorded beside each answer: ``operator`` or ``procedure``
    asks_again: bool  #: whether it may give another answer where one was refused

    def can_answer(self, prompt: Prompt) -> bool:
        """Return whether :meth:`answer` will be able to."""
        ...

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Return the answer; may wait for a person.

        ``objection`` is what spoke against the one given before, if there was one.
        """
        ...

    def withdraw(self) -> None:
        """Put the question that waits no longer: something else has ended what plays.

        Its :meth:`answer` may return whenever it likes; nobody takes what it gives.
        """
        ...


class OwnAnswers:
    """The procedure file's own answers: in simulation, and with ``--yes``."""

    by = "procedure"
    asks_again = False

    def can_answer(self, prompt: Prompt) -> bool:
        """A confirmation needs no answer of its own."""
        return prompt.answer is not None or prompt.kind is AnswerKind.CONFIRM

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Return the procedure's own answer."""
        if prompt.answer is not None:
            return prompt.answer
        if prompt.kind is AnswerKind.CONFIRM:
            return True
        raise ProcedureError(f"prompt {prompt.name!r} has no answer of its own")

    def withdraw(self) -> None:
        """Do nothing: none ever waits."""


def read_answer(prompt: Prompt, text: str) -> Answer:
    """Return what a person typed, as the prompt's type, numbers in SI.

    Raises:
        ValueError: cannot be read as an answer to this prompt.
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
                such = f": write '{text} {prompt.unit}'" if unitless else ""
                raise ValueError(f"{text!r} is not in {prompt.unit}{such}")
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
        ProcedureError: declined.
    """
    match prompt.kind:
        case AnswerKind.CONFIRM:
            if answer is not True:
                raise ProcedureError(f"prompt {prompt.name!r} was declined")
        case AnswerKind.NUMBER:
            if isinstance(answer, bool) or not isinstance(answer, int | float):
                raise AnswerRefused(
                    f"prompt {prompt.name!r} wants a number in {prompt.unit}, got {answer!r}"
                )
            _check_bounds(prompt, float(answer))
        case AnswerKind.CHOICE:
            if answer not in prompt.choices:
                raise AnswerRefused(
                    f"prompt {prompt.name!r}: {answer!r} is not one of {', '.join(prompt.choices)}"
                )
        case AnswerKind.TEXT:
            if not isinstance(answer, str):
                raise AnswerRefused(f"prompt {prompt.name!r} wants text, got {answer!r}")
    return answer


def _check_bounds(prompt: Prompt, value: float) -> None:
    # Written so that NaN is out of bounds too.
    low_ok = prompt.low is None or value >= prompt.low
    high_ok = prompt.high is None or value <= prompt.high
    if low_ok and high_ok and value == value:
        return
    bounds = [
        "" if item is None else format_quantity(item, prompt.unit)
        for item in (prompt.low, prompt.high)
    ]
    raise AnswerRefused(
        f"prompt {prompt.name!r}: {format_quantity(value, prompt.unit)} is outside "
        f"{bounds[0]} .. {bounds[1]}"
    )
