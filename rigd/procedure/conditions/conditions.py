"""Parses the conditions that end a step, and refuses those that can never be met.

Example: ``|belt.speed| < 3 mm/s for 0.2 s and scale is stable``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rigd.config.document import KeyPath
from rigd.config.loader import channel_names
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.language.number import ExpressionError, Number
from rigd.model.channels import Channel
from rigd.model.severity import Severity
from rigd.model.units import format_quantity
from rigd.procedure.conditions.condition_text import describe_condition
from rigd.procedure.expression import Scope, parse_expression
from rigd.procedure.program import Comparison, Condition, StatusCondition, TrialLimit, Until
from rigd.procedure.reader import Reader

_CLAUSE = re.compile(
    r"\s*(?P<open>\|)?\s*(?P<channel>[A-Za-z_]\w*(?:\.\w+)?)\s*(?P<close>\|)?\s*"
    r"(?P<sign>[<>])\s*(?P<threshold>[^<>=\s].*?)(?:\sfor\s(?P<time>.+))?$",
    re.DOTALL,
)
_STATUS = re.compile(
    r"\s*(?P<device>[A-Za-z_]\w*)\s+is\s+(?P<negated>not\s+)?(?P<word>[A-Za-z_]\w*)"
    r"(?:\s+for\s(?P<time>.+))?\s*$",
    re.DOTALL,
)
#: Operators of other languages, and the replacement, by first character.
_FOREIGN = re.compile(r"\s(?:OR|AND|not)\s|\|\||&&?|[<>=!]=|=")
_ANY = "join with 'or', or give a list: ['a.x > 1 m', 'b.y < 2 m']; 'and' binds more tightly"
_COMPARE = "compare with '>' or '<'; a measured value never equals a number"
_INSTEAD = {
    **dict.fromkeys("O|", _ANY),
    **dict.fromkeys("A&", "join with 'and'"),
    **dict.fromkeys("<>=!", _COMPARE),
    "n": "write the opposite comparison, or 'DEVICE is not WORD'",
}
_JOIN = re.compile(r"\sand\s")
_EITHER = re.compile(r"\sor\s")


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
    is_list = isinstance(reader.document.get(path), list)
    rows = []
    for index, text in enumerate(texts):
        where = (*path, index) if is_list else path
        start = 0
        for alternative in _EITHER.split(text):
            row = []
            for clause in _JOIN.split(alternative):
                if _STATUS.match(clause) is not None:
                    place = reader.document.inside(where, start)
                    reader.problems.add(place, f"{clause.strip()!r} compares no channel",
                                        "such as 'carriage.position > 1 mm'")  # fmt: skip
                elif condition := read_comparison(reader, where, clause, start, scope, finder):
                    row.append(condition)
                start += len(clause) + len(" and ")
            start += len(" or ") - len(" and ")
            rows.append(tuple(row))
    return tuple(rows)


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
    is_list = isinstance(reader.document.get(path), list)
    finder = ChannelFinder(rig.name, rig.channel, lambda: channel_names(rig))
    rows = []
    for index, text in enumerate(texts):
        where = (*path, index) if is_list else path
        start = 0
        for alternative in _EITHER.split(text):
            row: list[Condition | StatusCondition] = []
            for clause in _JOIN.split(alternative):
                status = _STATUS.match(clause)
                if status is not None:
                    word = _read_status(reader, where, status, start, scope, rig)
                    row += [] if word is None else [word]
                elif condition := read_comparison(reader, where, clause, start, scope, finder):
                    row.append(condition)
                    check_reachable(reader, where, start, condition, rig, limits)
                start += len(clause) + len(" and ")
            start += len(" or ") - len(" and ")
            rows.append(tuple(row))
    return tuple(rows)


def read_comparison(
    reader: Reader, path: KeyPath, text: str, start: int, scope: Scope, finder: ChannelFinder
) -> Condition | None:
    """Return the comparison ``text``, which begins at ``start``; None with the problem noted."""
    match = _CLAUSE.match(text)
    place = reader.document.inside(path, start)
    foreign = _FOREIGN.search(text)
    if foreign is not None:
        word = foreign[0].strip()
        place = reader.document.inside(path, start + foreign.start() + foreign[0].index(word))
        reader.problems.add(place, f"a condition cannot contain {word!r}", _INSTEAD[word[0]])
        return None
    if match is None or bool(match["open"]) != bool(match["close"]):
        hint = "such as 'carriage.position > 1.15 m' or '|belt.speed| < 3 mm/s for 0.2 s'"
        reader.problems.add(place, f"cannot read the condition {text.strip()!r}", hint)
        return None
    name = match["channel"]
    channel = finder.channel(reader, path, name, start + match.start("channel"))
    if channel is None:
        return None
    threshold = reader.number(
        path, match["threshold"], channel.shown_in, scope, start + match.start("threshold")
    )
    if match["open"] and _has_own_zero(match["threshold"], scope):
        place = reader.document.inside(path, start)
        bound = match["threshold"].strip()
        message = f"a magnitude cannot be compared with {bound}: it has a zero of its own"
        hint = f"remove the bars, or compare with a value in {channel.unit}"
        reader.problems.add(place, message, hint)
    return Condition(
        channel=name,
        comparison=Comparison(match["sign"]),
        threshold=threshold,
        magnitude=match["open"] is not None,
        for_s=_read_time(reader, path, match, start, scope),
        unit=channel.unit if match["open"] else channel.shown_in,
    )


def _has_own_zero(text: str, scope: Scope) -> bool:
    try:
        value = parse_expression(text).value(scope)
    except ExpressionError:
        return False
    return isinstance(value, Number) and bool(value.unit)


def _read_status(
    reader: Reader, path: KeyPath, match: re.Match[str], start: int, scope: Scope, rig: RigConfig
) -> StatusCondition | None:
    name, word = match["device"], match["word"]
    device = rig.devices.get(name)
    if device is None:
        place = reader.document.inside(path, start + match.start("device"))
        reader.problems.add_lacking(place, rig.name, "device", name, rig.devices)
        return None
    mask = device.declaration.status_bits.get(word)
    if mask is None:
        place = reader.document.inside(path, start + match.start("word"))
        words = device.declaration.status_bits
        reader.problems.add(
            place,
            f"{name} ({device.driver}) does not report whether it is {word}",
            suggest(word, words) if words else "none of its status bits has a name",
        )
        return None
    for_s = _read_time(reader, path, match, start, scope)
    return StatusCondition(name, word, mask, match["negated"] is None, for_s)


def _read_time(
    reader: Reader, path: KeyPath, match: re.Match[str], start: int, scope: Scope
) -> float:
    """Return the time after ``for``, 0 without ``for``."""
    if match["time"] is None:
        return 0.0
    for_s = reader.number(path, match["time"], "s", scope, start + match.start("time"))
    if for_s < 0:
        place = reader.document.inside(path, start)
        reader.problems.add(place, f"the time {match['time'].strip()} is negative")
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
