"""Prompts of a procedure file to prompts of a program."""

from __future__ import annotations

import math

from rigd.config.document import Path_
from rigd.config.problems import suggest
from rigd.model.units import format_quantity, parse_unit
from rigd.procedure.expression import Scope
from rigd.procedure.program import AnswerKind, Prompt
from rigd.procedure.reader import Reader
from rigd.procedure.source import PromptSource


def read_prompt(reader: Reader, path: Path_, source: PromptSource, scope: Scope) -> Prompt:
    """Return the prompt that stands at ``path``; problems are noted.

    What it asks for follows from its keys: ``unit`` a quantity, ``choices`` a word, ``free_text``
    any text, none of them a confirmation.
    """
    kind = _kind(reader, path, source)
    text = reader.text((*path, "text"), source.text, scope)
    _check_keys(reader, path, source, kind)
    if kind is AnswerKind.NUMBER:
        return _number_prompt(reader, path, source, text, scope)
    choices = tuple(
        reader.text((*path, "choices", index), one, scope)
        for index, one in enumerate(source.choices or ())
    )
    answer: str | bool | None = True if kind is AnswerKind.CONFIRM else None
    if source.answer is not None:
        answer = reader.text((*path, "answer"), source.answer, scope)
        if choices and answer not in choices:
            reader.note((*path, "answer"), f"{answer!r} is not one of the choices",
                        suggest(answer, choices))  # fmt: skip
    return Prompt(source.prompt, text, kind, choices=choices, answer=answer, changes=source.changes)


def _kind(reader: Reader, path: Path_, source: PromptSource) -> AnswerKind:
    given = {
        AnswerKind.NUMBER: source.unit is not None,
        AnswerKind.CHOICE: source.choices is not None,
        AnswerKind.TEXT: source.free_text,
    }
    kinds = [kind for kind, is_given in given.items() if is_given]
    if len(kinds) > 1:
        reader.note_key(path, "a prompt asks for one thing: unit, choices and free_text exclude "
                        "each other", "keep one of them")  # fmt: skip
    return kinds[0] if kinds else AnswerKind.CONFIRM


def _check_keys(reader: Reader, path: Path_, source: PromptSource, kind: AnswerKind) -> None:
    for key in ("min", "max"):
        if getattr(source, key) is not None and kind is not AnswerKind.NUMBER:
            reader.note_key((*path, key), f"{key} needs a unit",
                            "add 'unit: ...' (1 for a plain number)")  # fmt: skip
    if kind is AnswerKind.CONFIRM and source.answer is not None:
        reader.note_key((*path, "answer"), "a confirmation has no answer",
                        "add 'choices' or 'unit', or remove it")  # fmt: skip
    if source.changes is not None and source.answer is None:
        reader.note_key((*path, "changes"), "a simulated rig would not know the answer",
                        "add 'answer: ...'")  # fmt: skip


def _number_prompt(
    reader: Reader, path: Path_, source: PromptSource, text: str, scope: Scope
) -> Prompt:
    unit = source.unit or "1"
    try:
        parse_unit(unit)
    except ValueError as error:
        reader.note((*path, "unit"), str(error), "such as kg, mm, A")
        unit = "1"
    low, high, answer = (
        None if given is None else reader.number((*path, key), given, unit, scope)
        for key, given in (("min", source.min), ("max", source.max), ("answer", source.answer))
    )
    bottom = -math.inf if low is None else low
    top = math.inf if high is None else high
    if bottom > top:
        reader.note((*path, "min"), f"min {source.min} is above max {source.max}", "swap the two")
    if answer is not None and (answer < bottom or answer > top):
        reader.note(
            (*path, "answer"),
            f"the answer {format_quantity(answer, unit)} is outside "
            f"{format_quantity(bottom, unit)} to {format_quantity(top, unit)}",
            "change the answer, or min and max",
        )
    return Prompt(
        source.prompt, text, AnswerKind.NUMBER, unit=unit, low=low, high=high, answer=answer,
        changes=source.changes,
    )  # fmt: skip
