"""Compiles the prompts (questions to the operator) of a procedure file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

from rigd.config.document import KeyPath
from rigd.config.loader import channel_names
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.config.sibling.sibling import read_sibling
from rigd.language.number import Number
from rigd.model.errors import ConfigError
from rigd.model.limits import rounded_to
from rigd.model.units import format_quantity, meant_unit, parse_unit
from rigd.procedure.conditions.conditions import check_reachable, read_until
from rigd.procedure.expression import Scope
from rigd.procedure.program import Agreement, AnswerKind, Prompt, StatusCondition, Until
from rigd.procedure.reader import Reader
from rigd.procedure.source import AgreesSource, PromptSource
from rigd.procedure.steps.agreement import inside
from rigd.sdk.setting import Setting

#: The word for a device's report that its reading has come to rest.
STABLE: Final = "stable"
#: The prefix of settings in the list of what a rig lacks: ``plant.floor``.
PLANT: Final = "plant"


@dataclass(frozen=True)
class ChangeablePlant:
    """A simulated plant whose ``settings`` answers can change; ``rig`` is its name in errors."""

    rig: str
    settings: Mapping[str, Setting]


def changeable_plants(rig: RigConfig) -> Iterator[ChangeablePlant]:
    """Yield each plant that a procedure for ``rig`` plays on: that of the rig, of its sibling.

    A sibling that is wrong is left out: the check of the rig file names what is wrong with it.
    """
    if rig.settings is not None:
        yield ChangeablePlant(rig.name, rig.settings)
    with suppress(ConfigError):
        sibling = read_sibling(rig)
        if sibling is not None and sibling.rig.settings is not None:
            yield ChangeablePlant(sibling.rig.name, sibling.rig.settings)


def read_prompt(
    reader: Reader,
    path: KeyPath,
    source: PromptSource,
    scope: Scope,
    rig: RigConfig,
    plants: Sequence[ChangeablePlant],
) -> Prompt:
    """Return the prompt at ``path``, with its check; problems are noted.

    ``plants`` are the :func:`changeable_plants` of ``rig``, if the prompt changes one. Its keys
    decide the kind of answer: ``unit`` a quantity, ``choices`` a word, ``free_text`` any text, none
    of them a confirmation.
    """
    prompt = _question(reader, path, source, scope)
    until: Until = ()
    if source.until is not None:
        until = read_until(reader, (*path, "until"), source.until, scope, rig, limits=())
    agrees = None
    if source.agrees is not None:
        agrees = _agreement(reader, (*path, "agrees"), source.agrees, prompt, scope, rig)
    _check_timeout(reader, path, source)
    for plant in plants:
        if (problem := change_problem(prompt, plant)) is not None:
            place = reader.document.place((*path, problem.key))
            lacks = f"{PLANT}.{prompt.changes}"
            reader.problems.add(place, problem.message, problem.hint, lacks=lacks)
    timeout_s = reader.time((*path, "timeout"), source.timeout, scope)
    return replace(prompt, until=until, agrees=agrees, timeout_s=timeout_s)


def _question(reader: Reader, path: KeyPath, source: PromptSource, scope: Scope) -> Prompt:
    kind = _kind(reader, path, source)
    text = reader.text((*path, "text"), source.text, scope)
    _check_keys(reader, path, source, kind)
    if kind is AnswerKind.NUMBER:
        return _number_prompt(reader, path, source, text, scope)
    choices = tuple(
        reader.text((*path, "choices", index), item, scope)
        for index, item in enumerate(source.choices or ())
    )
    answer: str | bool | None = True if kind is AnswerKind.CONFIRM else None
    if source.answer is not None:
        answer = reader.text((*path, "answer"), source.answer, scope)
        if choices and answer not in choices:
            reader.note((*path, "answer"), f"{answer!r} is not one of the choices",
                        suggest(answer, choices))  # fmt: skip
    return Prompt(source.prompt, text, kind, choices=choices, answer=answer, changes=source.changes)


def _kind(reader: Reader, path: KeyPath, source: PromptSource) -> AnswerKind:
    given = {
        AnswerKind.NUMBER: source.unit is not None,
        AnswerKind.CHOICE: source.choices is not None,
        AnswerKind.TEXT: source.free_text,
    }
    kinds = [kind for kind, is_given in given.items() if is_given]
    if len(kinds) > 1:
        reader.note_key(path, "unit, choices and free_text exclude each other", "keep one of them")
    return kinds[0] if kinds else AnswerKind.CONFIRM


def _check_keys(reader: Reader, path: KeyPath, source: PromptSource, kind: AnswerKind) -> None:
    for key in ("min", "max"):
        if getattr(source, key) is not None and kind is not AnswerKind.NUMBER:
            reader.note_key((*path, key), f"{key} needs a unit",
                            "add 'unit: ...' (1 for a plain number)")  # fmt: skip
    if kind is AnswerKind.CONFIRM and source.answer is not None:
        reader.note_key((*path, "answer"), "a confirmation has no answer",
                        "add 'choices' or 'unit', or remove the answer")  # fmt: skip
    if source.changes is not None and source.answer is None:
        reader.note_key((*path, "changes"), "a simulated rig would have no answer",
                        "add 'answer: ...'")  # fmt: skip


def _number_prompt(
    reader: Reader, path: KeyPath, source: PromptSource, text: str, scope: Scope
) -> Prompt:
    unit = source.unit or "1"
    try:
        parse_unit(unit)
    except ValueError as error:
        reader.note((*path, "unit"), str(error), "such as kg, mm, A")
        unit = meant_unit(unit) or "1"
    low, high, answer = (
        None if given is None else reader.number((*path, key), given, unit, scope)
        for key, given in (("min", source.min), ("max", source.max), ("answer", source.answer))
    )
    bottom = -math.inf if low is None else low
    top = math.inf if high is None else high
    if bottom > top:
        reader.note((*path, "min"), f"min {source.min} is above max {source.max}", "swap the two")
    if answer is not None:
        answer = rounded_to(bottom, answer, top)
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


def _agreement(
    reader: Reader,
    path: KeyPath,
    source: AgreesSource,
    prompt: Prompt,
    scope: Scope,
    rig: RigConfig,
) -> Agreement | None:
    if prompt.kind is not AnswerKind.NUMBER:
        reader.note_key(path, "only a quantity can agree with a channel",
                        "add 'unit: ...', or check a condition with 'until: ...'")  # fmt: skip
        return None
    channel = rig.channel(source.channel)
    if channel is None:
        place = reader.document.place((*path, "with"))
        known = channel_names(rig)
        reader.problems.add_lacking(place, rig.name, "channel", source.channel, known)
        return None
    if not parse_unit(channel.unit).same_kind(parse_unit(prompt.unit)):
        message = f"{source.channel} is in {channel.unit}, the answer in {prompt.unit}"
        hint = f"ask with 'unit: {channel.unit}', or choose a channel in {prompt.unit}"
        reader.note((*path, "with"), message, hint)
        return None
    value = reader.value((*path, "within"), source.within, scope)
    is_share = isinstance(value, Number) and not any(value.dimension)
    unit = "1" if is_share else channel.unit
    within = math.nan if value is None else reader.difference(
        (*path, "within"), source.within, unit, scope
    )  # fmt: skip
    if is_share and parse_unit(prompt.unit).offset:
        message = f"{source.within} of a value in {prompt.unit} has no meaning"
        reader.note(
            (*path, "within"), message, f"such as '1 {parse_unit(prompt.unit).difference()}'"
        )
    if within <= 0 or (is_share and prompt.answer == 0.0):
        reader.note((*path, "within"), "no answer would ever agree",
                    f"give a quantity above 0 {channel.unit}")  # fmt: skip
    device = source.channel.partition(".")[0]
    mask = rig.devices[device].declaration.status_bits.get(STABLE)
    agreement = Agreement(
        source.channel,
        within,
        is_share,
        reader.time((*path, "for"), source.wait, scope) or 0.0,
        None if mask is None else StatusCondition(device, STABLE, mask),
    )
    if isinstance(prompt.answer, float):
        for condition in inside(agreement, prompt.answer, prompt.unit):
            check_reachable(reader, (*path, "with"), 0, condition, rig, ())
    return agreement


@dataclass(frozen=True)
class ChangeProblem:
    """Why a plant cannot follow the answer of a prompt; ``key`` is that of the prompt."""

    key: str
    message: str
    hint: str = ""


def change_problem(prompt: Prompt, plant: ChangeablePlant) -> ChangeProblem | None:
    """Return why ``plant`` cannot follow the planned answer of ``prompt``; None if it can.

    The name of the setting, its unit and its range or choices are compared.
    """
    name, answer = prompt.changes, prompt.answer
    if name is None:
        return None
    setting = plant.settings.get(name)
    if setting is None:
        message = f"the plant of {plant.rig} has no {name!r} to change"
        return ChangeProblem("changes", message, suggest(name, plant.settings))
    unit = prompt.unit if prompt.kind is AnswerKind.NUMBER else ""
    if bool(unit) != bool(setting.unit) or not parse_unit(unit).same_kind(parse_unit(setting.unit)):
        message = (
            f"the prompt asks for {unit or 'a word'}, but {name} on the plant of {plant.rig} takes "
            f"{setting}"
        )
        return ChangeProblem("changes", message)
    if isinstance(answer, float | str) and answer == answer:
        try:
            setting.accepted(name, answer)
        except ValueError as error:
            return ChangeProblem("answer", f"{error} on the plant of {plant.rig}")
    return None


def _check_timeout(reader: Reader, path: KeyPath, source: PromptSource) -> None:
    waits = "agrees" if source.agrees is not None else "until" if source.until is not None else ""
    if waits and source.timeout is None:
        message = f"the check of prompt {source.prompt!r} could wait forever"
        reader.note_key((*path, waits), message, "add 'timeout: 10 s'")
    if source.timeout is not None and not waits:
        reader.note_key((*path, "timeout"), "a timeout has no effect without a check: the "
                                            "operator has no time limit",
                        "remove it, or add a check by 'agrees' or 'until'")  # fmt: skip
