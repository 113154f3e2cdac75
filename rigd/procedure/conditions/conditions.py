"""Parses the conditions that end a step, and refuses those that can never be met.

Example: ``|belt.speed| < 3 mm/s for 0.2 s and scale is stable``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from rigd.config.document import KeyPath
from rigd.config.loader import channel_names
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.language.number import ExpressionError, Number
from rigd.language.syntax import (
    ComparisonChain,
    FunctionCall,
    HeldCondition,
    Name,
    Node,
    Operation,
    State,
    children,
    parse,
)
from rigd.model.channels import Channel
from rigd.model.severity import Severity
from rigd.model.units import format_quantity
from rigd.procedure.conditions.condition_text import describe_condition
from rigd.procedure.expression import Scope, parse_expression
from rigd.procedure.program import Comparison, Condition, StatusCondition, TrialLimit, Until
from rigd.procedure.reader import Reader

#: Most characters of a condition.
_MAX_LENGTH = 1000


@dataclass(frozen=True)
class ChannelFinder:
    """Finds the channels that a condition may compare; ``owner`` is the rig that may lack them."""

    owner: str
    find: Callable[[str], Channel | None]
    names: Callable[[], Sequence[str]]

    def channel(self, reader: Reader, path: KeyPath, name: str, offset: int = 0) -> Channel | None:
        """Return the channel, or None with the problem noted."""
        channel = self.find(name)
        if channel is None:
            place = reader.document.inside(path, offset)
            reader.problems.add_lacking(place, self.owner, "channel", name, self.names())
        return channel


def read_comparisons(
    reader: Reader, path: KeyPath, texts: Sequence[str], scope: Scope, finder: ChannelFinder
) -> tuple[tuple[Condition, ...], ...]:
    """Return conditions that compare channels: rows of which any must hold; problems are noted."""
    rows = []
    for where, text, clauses in _rows(reader, path, texts):
        row = []
        for clause in clauses:
            if isinstance(_held(clause)[0], State):
                place = reader.document.inside(where, clause.start)
                shown = text[clause.start : clause.end]
                reader.problems.add(place, f"{shown!r} compares no channel",
                                    "such as 'carriage.position > 1 mm'")  # fmt: skip
            elif condition := read_comparison(reader, where, text, clause, scope, finder):
                row.append(condition)
        rows.append(tuple(row))
    return tuple(rows)


def _rows(
    reader: Reader, path: KeyPath, texts: Sequence[str]
) -> Iterator[tuple[KeyPath, str, Sequence[Node]]]:
    """Yield the place and the text of each alternative, and the conditions that it joins."""
    is_list = isinstance(reader.document.get(path), list)
    for index, text in enumerate(texts):
        where = (*path, index) if is_list else path
        try:
            tree = parse(text, _MAX_LENGTH)
        except ExpressionError as error:
            place = reader.document.inside(where, error.offset)
            reader.problems.add(place, str(error), error.hint)
            continue
        for alternative in _joined(tree, "or"):
            yield where, text, _joined(alternative, "and")


def _joined(node: Node, word: str) -> Sequence[Node]:
    is_joined = isinstance(node, Operation) and node.sign == word
    return children(node) if is_joined else (node,)


def _held(clause: Node) -> tuple[Node, Node | None]:
    """Return the condition of a clause, and how long it holds."""
    if isinstance(clause, HeldCondition):
        return clause.condition, clause.time
    return clause, None


def read_until(
    reader: Reader,
    path: KeyPath,
    texts: Sequence[str],
    scope: Scope,
    rig: RigConfig,
    limits: Sequence[TrialLimit],
) -> Until:
    """Return the conditions of ``until``: rows of which any must hold; problems are noted.

    ``limits`` are those of the trial that contains the step.
    """
    finder = ChannelFinder(rig.name, rig.channel, lambda: channel_names(rig))
    rows = []
    for where, text, clauses in _rows(reader, path, texts):
        row: list[Condition | StatusCondition] = []
        for clause in clauses:
            match _held(clause):
                case State(subject=Name() as device, word=word, is_so=is_so), time:
                    mask = _read_status(reader, where, device, word, rig)
                    for_s = _read_time(reader, where, text, clause.start, time, scope)
                    if mask is not None:
                        row.append(StatusCondition(device.name, word.name, mask, is_so, for_s))
                case _:
                    condition = read_comparison(reader, where, text, clause, scope, finder)
                    if condition is not None:
                        row.append(condition)
                        check_reachable(reader, where, clause.start, condition, rig, limits)
        rows.append(tuple(row))
    return tuple(rows)


def read_comparison(
    reader: Reader, path: KeyPath, text: str, clause: Node, scope: Scope, finder: ChannelFinder
) -> Condition | None:
    """Return the comparison ``clause``, a part of ``text``; None with the problem noted."""
    place = reader.document.inside(path, clause.start)
    condition, time = _held(clause)
    match condition:
        case ComparisonChain(signs=("<" | ">" as sign,), operands=(Name() as name, bound)):
            is_magnitude = False
        case ComparisonChain(
            signs=("<" | ">" as sign,),
            operands=(FunctionCall(name="abs", items=(Name() as name,)), bound),
        ):
            is_magnitude = True
        case ComparisonChain(signs=(sign,), operands=(_, bound)) if sign not in "<>":
            place = reader.document.inside(path, bound.start)
            hint = "compare with '>' or '<'; a measured value never equals a number"
            reader.problems.add(place, f"a condition cannot contain {sign!r}", hint)
            return None
        case _:
            shown = text[clause.start : clause.end]
            hint = "such as 'carriage.position > 1.15 m' or '|belt.speed| < 3 mm/s for 0.2 s'"
            reader.problems.add(place, f"cannot read the condition {shown!r}", hint)
            return None
    channel = finder.channel(reader, path, name.name, name.start)
    if channel is None:
        return None
    written = text[bound.start : bound.end]
    threshold = reader.number(path, written, channel.shown_in, scope, bound.start)
    if is_magnitude and _has_own_zero(written, scope):
        message = f"a magnitude cannot be compared with {written}: it has a zero of its own"
        hint = f"remove the bars, or compare with a value in {channel.unit}"
        reader.problems.add(place, message, hint)
    return Condition(
        channel=name.name,
        comparison=Comparison(sign),
        threshold=threshold,
        magnitude=is_magnitude,
        for_s=_read_time(reader, path, text, clause.start, time, scope),
        unit=channel.unit if is_magnitude else channel.shown_in,
    )


def _has_own_zero(text: str, scope: Scope) -> bool:
    try:
        value = parse_expression(text).value(scope)
    except ExpressionError:
        return False
    return isinstance(value, Number) and bool(value.unit)


def _read_status(
    reader: Reader, path: KeyPath, name: Name, word: Name, rig: RigConfig
) -> int | None:
    """Return the status bit ``word`` of a device, or None with the problem noted."""
    device = rig.devices.get(name.name)
    if device is None:
        place = reader.document.inside(path, name.start)
        reader.problems.add_lacking(place, rig.name, "device", name.name, rig.devices)
        return None
    words = device.declaration.status_bits
    mask = words.get(word.name)
    if mask is None:
        reader.problems.add(
            reader.document.inside(path, word.start),
            f"{name.name} ({device.driver}) does not report whether it is {word.name}",
            suggest(word.name, words) if words else "none of its status bits has a name",
        )
    return mask


def _read_time(
    reader: Reader, path: KeyPath, text: str, start: int, time: Node | None, scope: Scope
) -> float:
    """Return the time after ``for``, 0 without ``for``."""
    if time is None:
        return 0.0
    written = text[time.start : time.end]
    for_s = reader.number(path, written, "s", scope, time.start)
    if for_s < 0:
        place = reader.document.inside(path, start)
        reader.problems.add(place, f"the time {written} is negative")
    return for_s


def check_reachable(
    reader: Reader,
    path: KeyPath,
    start: int,
    condition: Condition,
    rig: RigConfig,
    limits: Sequence[TrialLimit],
) -> None:
    """Note a condition that a range, an interlock or a trial limit always precedes."""
    channel = rig.channel(condition.channel)
    if channel is None:
        return
    hint = "choose a threshold inside that range"
    barriers = [(channel.low, channel.high, f"{condition.channel} measures")]
    barriers += [
        (limit.low, limit.high, "the trial's limit keeps it")
        for limit in limits
        if limit.channel == condition.channel
    ]
    for lock in rig.interlocks:
        at_once = not lock.delay_s  # else the value may leave the bounds for a time
        if lock.source == condition.channel and lock.action > Severity.WARN and at_once:
            low = lock.low if isinstance(lock.low, float) else -math.inf
            high = lock.high if isinstance(lock.high, float) else math.inf
            barriers.append((low, high, f"interlock {lock.name} keeps it"))
    for low, high, owner in barriers:
        if _precedes(condition, low, high):
            reader.problems.add(
                reader.document.inside(path, start),
                f"{describe_condition(condition)} can never be reached: {owner} "
                f"{_between(low, high, channel.shown_in)}",
                hint,
            )
            return


def _between(low: float, high: float, unit: str) -> str:
    if math.isinf(low):
        return f"below {format_quantity(high, unit)}"
    if math.isinf(high):
        return f"above {format_quantity(low, unit)}"
    return f"between {format_quantity(low, unit)} and {format_quantity(high, unit)}"


def _precedes(condition: Condition, low: float, high: float) -> bool:
    threshold = condition.threshold
    if condition.comparison is Comparison.ABOVE:
        return threshold >= (max(abs(low), abs(high)) if condition.magnitude else high)
    return threshold <= (0.0 if condition.magnitude else low)
