"""Reads the trials of a run from its events; no sample is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from rigd.model.units import format_quantity
from rigd.record.events.event import Event

#: State of a run whose recording has no ``run_end`` after its last ``run_start``, and reason of a
#: trial that another began within.
INTERRUPTED: Final = "interrupted"
_ENDS_STEP: Final = (
    "step", "hold", "prompt", "trial_start", "trial_end", "run_start", "run_end",
)  # fmt: skip


@dataclass(frozen=True)
class TrialInfo:
    """One attempt at a trial; ``end_ns`` is None if the recording ends within it.

    ``answers`` has the last answer for each quantity that prompts set up (``load``, in SI), in this
    trial or an earlier trial; it may differ from the ``parameters``.
    """

    number: int
    start_ns: int
    end_ns: int | None = None
    repeat: int | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    complete: bool = False
    reason: str = ""
    answers: Mapping[str, Any] = field(default_factory=dict)
    lost: str = ""  #: which of its rows the recording has lost, in words

    def text(self, name: str) -> str:
        """Return the value of a parameter as a person writes it; "" if the trial has none."""
        value, unit = self.parameters.get(name, ""), self.units.get(name)
        if unit is None or isinstance(value, str | bool):
            return str(value)
        return format_quantity(float(value), unit)


@dataclass(frozen=True)
class Step:
    """A step of the procedure as it was played; ``trial`` is -1 outside of trials.

    ``end_ns`` is None if the recording ends within it.
    """

    name: str
    trial: int
    start_ns: int
    end_ns: int | None = None


def steps(events: Sequence[Event]) -> tuple[Step, ...]:
    """Return the steps in the order of their start; each ends with the next step or its trial.

    A step before a prompt ends where the prompt begins: the rig waits for the answer in no step. An
    event ``step`` without a name, as of an imported file, ends the step before it. A step that was
    held ends there, and begins again where its time goes on: what was recorded meanwhile belongs to
    no step.
    """
    done: list[Step] = []
    current: Step | None = None
    for event in sorted(events, key=lambda event: event.t_ns):
        if event.kind not in _ENDS_STEP:
            continue
        if current is not None:
            done.append(replace(current, end_ns=event.t_ns))
            current = None
        if event.kind == "step" and (name := str(event.data.get("name", ""))):
            current = Step(name, event.trial, event.t_ns)
        elif event.kind == "hold" and event.data.get("phase") == "over":
            current = Step(str(event.data.get("step", "")), event.trial, event.t_ns)
    return (*done, current) if current is not None else tuple(done)


def held(events: Sequence[Event], trial: TrialInfo) -> str:
    """Return which steps of ``trial`` were held, in words; "" if none was."""
    end_ns = trial.end_ns
    found = dict.fromkeys(
        repr(str(event.data.get("step", "")))
        for event in events
        if event.kind == "hold"
        and event.trial == trial.number
        and trial.start_ns <= event.t_ns
        and (end_ns is None or event.t_ns <= end_ns)
    )
    return f"held by a pause in step {', '.join(found)}" if found else ""


def trials(events: Sequence[Event]) -> tuple[TrialInfo, ...]:
    """Return every attempt at a trial, in the order they began.

    An attempt ends at its ``trial_end``; if that is missing, it ends at the next ``trial_start`` or
    ``run_start``, because its true end is not known.
    """
    done: list[TrialInfo] = []
    current: TrialInfo | None = None
    answers: dict[str, Any] = {}
    for event in sorted(events, key=lambda event: event.t_ns):
        if current is not None and event.kind in ("trial_start", "run_start"):
            done.append(_ended(current, event.t_ns, {"reason": INTERRUPTED}))
            current = None
        if event.kind == "run_start":
            answers = {}  # a resumed run asks its prompts again, or states what holds
        if event.kind == "answer" and event.data.get("changes"):
            answers = {**answers, event.data["changes"]: event.data.get("answer")}
            if current is not None:
                current = replace(current, answers=answers)
        if event.kind == "trial_start":
            answers = event.data.get("answers") or answers  # of trials simulated again
            current = TrialInfo(
                number=event.trial,
                start_ns=event.t_ns,
                repeat=event.data.get("repeat"),
                parameters=event.data.get("parameters") or {},
                units=event.data.get("units") or {},
                answers=answers,
            )
        elif event.kind == "trial_end" and current is not None and event.trial == current.number:
            done.append(_ended(current, event.t_ns, event.data))
            current = None
    return (*done, current) if current is not None else tuple(done)


def _ended(trial: TrialInfo, end_ns: int, data: Mapping[str, Any]) -> TrialInfo:
    # Not `replace`: the index of many recordings needs this for each of their trials.
    return TrialInfo(
        trial.number,
        trial.start_ns,
        end_ns,
        trial.repeat,
        trial.parameters,
        trial.units,
        bool(data.get("complete", False)),
        str(data.get("reason") or ""),
        trial.answers,
    )
