"""Lists the rows that a recording has lost, with their stream and their times.

Every message carries its number in its stream, so the messages that are missing between two intact
chunks are known exactly. After the last intact chunk, lost rows are known from the summary of the
file, and from message indexes that are intact although their chunks are not.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final

from rigd.record.events.event import Event
from rigd.record.events.trials import TrialInfo
from rigd.record.mcap.schema import EVENTS_STREAM

#: Message numbers are of 32 bits; further apart than half of that is backwards.
_NUMBERS: Final = 1 << 32
#: A stream that is silent for so many of its periods while others go on has lost its end.
_SILENT_PERIODS: Final = 3


@dataclass(frozen=True)
class Gap:
    """Rows of a stream that are lost, from after ``start_ns`` (or at it) to ``end_ns``.

    ``rows`` is None if that number is not known.
    """

    stream: str
    start_ns: int
    end_ns: int
    rows: int | None


@dataclass(frozen=True)
class Span:
    """Consecutive messages of one channel: their times, and their numbers if known."""

    start_ns: int
    end_ns: int
    count: int
    first: int | None = None  #: number of the first message in its stream
    last: int | None = None  #: of the last message; known of files of others

    def covers(self, other: Span) -> bool:
        """Return whether it reaches from the start to the end of another."""
        return self.start_ns <= other.start_ns and self.end_ns >= other.end_ns


def find_gaps(
    topic: str, held: Sequence[Span], indexed: Iterable[Span], known: Sequence[Gap], start_ns: int
) -> list[Gap]:
    """Return the gaps of one channel, in order of time.

    ``held`` are its intact chunks in the order of the file, ``indexed`` the rows according to the
    indexes, ``known`` the gaps that an earlier repair found. The recording began at ``start_ns``.
    """
    stream = topic.removeprefix("/")
    lost: dict[tuple[int, int], int] = {}
    exact = {(item.start_ns, item.end_ns) for item in held}  # so it is with nearly all
    for span in indexed:
        if (span.start_ns, span.end_ns) in exact or any(item.covers(span) for item in held):
            continue
        # An earlier state of an open chunk may be there, with its first rows.
        begun = [item for item in held if item.start_ns == span.start_ns]
        first_ns = begun[0].end_ns if begun else span.start_ns
        lost[first_ns, span.end_ns] = span.count - (begun[0].count if begun else 0)
    gaps = [gap for gap in known if gap.stream == stream]
    gaps += [Gap(stream, first, last, count) for (first, last), count in lost.items()]
    before_ns, number = start_ns, 0
    for span in held:
        if span.first is None:
            before_ns, number = span.end_ns, number + span.count
            continue
        missing = (span.first - number) % _NUMBERS
        if 0 < missing < _NUMBERS // 2:
            inside = (
                gap.rows or 0
                for gap in gaps
                if before_ns <= gap.start_ns and gap.end_ns <= span.start_ns
            )
            if missing > (found := sum(inside)):
                gaps.append(Gap(stream, before_ns, span.start_ns, missing - found))
        before_ns, number = span.end_ns, span.first + span.count
    return sorted(set(gaps), key=lambda gap: gap.start_ns)


def silent_end(topic: str, held: Sequence[Span], end_ns: int) -> list[Gap]:
    """Return the gap at the end of a stream that became silent before ``end_ns``, if there is one.

    For a file without its summary, which would contain the number of rows.
    """
    if not held or held[-1].count < 2:
        return []
    last = held[-1]
    period_ns = (last.end_ns - last.start_ns) / (last.count - 1)
    if end_ns - last.end_ns <= _SILENT_PERIODS * period_ns:
        return []
    return [Gap(topic.removeprefix("/"), last.end_ns, end_ns, None)]


def gaps_to_json(gaps: Sequence[Gap]) -> str:
    """Return gaps as JSON."""
    return json.dumps([asdict(gap) for gap in gaps], separators=(",", ":"))


def gaps_from_json(text: str) -> tuple[Gap, ...]:
    """Return the gaps that :func:`gaps_to_json` wrote.

    Raises:
        ValueError: the text is not such JSON.

    """
    try:
        return tuple(
            Gap(
                str(load["stream"]),
                int(load["start_ns"]),
                int(load["end_ns"]),
                None if load["rows"] is None else int(load["rows"]),
            )
            for load in json.loads(text)
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"not a list of gaps: {error!r}") from error


def with_losses(
    attempts: Sequence[TrialInfo], gaps: Sequence[Gap], events: Sequence[Event], *, asks: bool
) -> tuple[TrialInfo, ...]:
    """Return the trials with the losses of each; a trial that lost rows is not complete.

    ``asks``: prompts of the procedure set up its quantities. A lost answer affects all following
    trials, which are then not complete either.
    """
    if not gaps:
        return tuple(attempts)
    starts = [event.t_ns for event in events if event.kind == "run_start"]
    unanswered = [gap for gap in gaps if asks and gap.stream == EVENTS_STREAM]
    found: list[TrialInfo] = []
    for trial in attempts:
        texts = [describe_rows(gap) for gap in gaps if _touches(gap, trial)]
        run_ns = max((at for at in starts if at <= trial.start_ns), default=0)
        if any(run_ns <= gap.end_ns <= trial.start_ns for gap in unanswered):
            texts.append("answers given before it")
        if texts:
            lost = f"lost: {', '.join(texts)}"
            reason = lost if trial.complete else trial.reason
            trial = replace(trial, complete=False, reason=reason, lost=lost)
        found.append(trial)
    return tuple(found)


def describe_rows(gap: Gap) -> str:
    """Return how many rows of which stream are lost, in words."""
    if gap.rows is None:
        return f"an unknown number of rows of {gap.stream}"
    things = "event" if gap.stream == EVENTS_STREAM else "row"
    number = f"{gap.rows} {things}{'' if gap.rows == 1 else 's'}"
    return number if gap.stream == EVENTS_STREAM else f"{number} of {gap.stream}"


def gap_text(gap: Gap, start_ns: int) -> str:
    """Return which rows are lost and when, in s since the recording began."""
    first, last = ((at - start_ns) * 1e-9 for at in (gap.start_ns, gap.end_ns))
    return f"{describe_rows(gap)}, {first:.3f} s to {last:.3f} s"


def gaps_json(gaps: Sequence[Gap], start_ns: int) -> list[Mapping[str, object]]:
    """Return gaps for programs that read rigd's output; times in s since the recording began."""
    return [
        {
            "stream": gap.stream,
            "rows": gap.rows,
            "from_s": (gap.start_ns - start_ns) * 1e-9,
            "to_s": (gap.end_ns - start_ns) * 1e-9,
        }
        for gap in gaps
    ]


def _touches(gap: Gap, trial: TrialInfo) -> bool:
    return gap.end_ns >= trial.start_ns and (trial.end_ns is None or gap.start_ns < trial.end_ns)
