"""Makes the verdict on one model from the errors in the trials of one recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rigd.analysis.report.rounding import number, places_for
from rigd.analysis.result import TrialRejection
from rigd.analysis.validation.result import (
    Deviation,
    GroupValidation,
    ModelOutcome,
    OutputTrace,
    ValidatedTrial,
    pooled,
)
from rigd_analyses.lugre.validation.attempt import DRIVE, Attempt
from rigd_analyses.lugre.validation.bias import bias, biases, shown_at_rest
from rigd_analyses.lugre.validation.friction import Friction
from rigd_analyses.lugre.validation.motion import (
    FORCE,
    SLIP,
    SPEED,
    UNITS,
    ZERO,
    DrivenMotion,
    Simulated,
    rms,
)
from rigd_analyses.lugre.validation.paper import published_speed_rms
from rigd_analyses.lugre.validation.search import PLAUSIBLE_DRIVE, Search, pull, search

#: A limit above this share of the slip itself cannot separate a model from one without slip.
CONCLUSIVE: Final = 0.25
SUSPECTS: Final = 2  #: that are named
#: Slip beyond the visited one by this factor is extrapolation.
BEYOND: Final = 1.1


def judged(
    label: str,
    model: str,
    motions: Sequence[DrivenMotion],
    friction: Friction,
    left_out: Sequence[TrialRejection],
    findings: Sequence[str],
) -> GroupValidation:
    """Return the verdict on ``friction`` by ``motions``, the trials of one recording.

    ``label`` and ``model`` are what a person calls trials and model; ``findings`` is what is known
    before.
    """
    found = search(motions, friction)
    trials = tuple(
        _trial(before, after, limit, friction)
        for before, after, limit in zip(
            found.stated.simulated, found.found.simulated, found.found.limits, strict=True
        )
    )
    slip = pooled([trial.deviation(SLIP) for trial in trials])
    speed = pooled([trial.deviation(SPEED) for trial in trials])
    left = f"slip is {_mm(slip)} off and speed {_mm(speed)}, over {_count(len(trials))}"
    if not found.explained:
        outcome, sentence = ModelOutcome.REJECTED, _rejected(trials, found)
    elif _contradicted(found):
        outcome = ModelOutcome.REJECTED
        contradiction = " ".join(item.sentence for item in biases(found.found))
        sentence = f"The constants of the recording contradict its motion. {contradiction}"
    elif (slip.limit or 0.0) > CONCLUSIVE * slip.size:
        outcome = ModelOutcome.UNTESTED
        sentence = (
            f"These trials cannot decide: noise and uncertainties allow an error of "
            f"{number(1e3 * (slip.limit or 0.0), digits=2)} mm/s, the slip itself is "
            f"{number(1e3 * slip.size, digits=2)} mm/s."
        )
    elif found.found.names:
        outcome = ModelOutcome.CORRECTED
        excuse = " ".join(item.sentence for item in biases(found.found))
        sentence = f"{excuse} With that, {left}."
    else:
        outcome = ModelOutcome.CONFIRMED
        sentence = f"With all constants as stated, {left}."
    lines = [*findings, *_equal(found), *_extrapolated(trials, friction)]
    if not friction.uncertain:
        lines.append("The file states no uncertainty of the model: it counts as exact.")
    return GroupValidation(
        label, model, outcome, sentence, trials, biases(found.found), tuple(lines), tuple(left_out)
    )


def _trial(
    before: Simulated, after: Simulated, limit: dict[str, float], friction: Friction
) -> ValidatedTrial:
    motion = after.motion
    published = published_speed_rms(
        motion.conditions.get("floor"), motion.constants.mass.value, motion.trial.current_a
    )
    deviations = tuple(
        Deviation(
            output,
            UNITS[output],
            rms(before.error(output)),
            rms(after.error(output)),
            rms(after.measured(output)),
            limit.get(output),
            published if output == SPEED else None,
        )
        for output in (SLIP, SPEED, FORCE)
    )
    traces = tuple(
        OutputTrace(output, UNITS[output], after.measured(output), after.modelled(output))
        for output in (SPEED, SLIP, FORCE)
    )
    reached = float(max(abs(after.modelled(SLIP))))
    note = ""
    if friction.visited_m_s is not None and reached > BEYOND * friction.visited_m_s[1]:
        note = f"slip up to {number(1e3 * reached, digits=3)} mm/s, beyond that identified"
    return ValidatedTrial(
        motion.trial.label, motion.trial.recording, motion.conditions, deviations, motion.t_s,
        traces, note,
    )  # fmt: skip


def _contradicted(found: Search) -> bool:
    """Whether the drive's constants would have to be far from what is stated.

    A zero of the current that the monitor shows at rest is a fact, however large.
    """
    item = found.found
    far = [name for name in item.names if name in DRIVE and pull(item, name) > PLAUSIBLE_DRIVE]
    return any(not (name == ZERO and shown_at_rest(item)) for name in far)


def _rejected(trials: Sequence[ValidatedTrial], found: Search) -> str:
    """Return what is off, where most, and which constant could explain it."""
    parts = []
    for output in (SLIP, SPEED):
        off = [trial for trial in trials if not trial.deviation(output).passes]
        if not off:
            continue
        worst = max(off, key=lambda trial: _excess(trial.deviation(output)))
        own = worst.deviation(output)
        parts.append(
            f"the {output} is {_mm(pooled([t.deviation(output) for t in off]))} off in "
            f"{len(off)} of {_count(len(trials))}, most at {_named(worst)} ({_mm(own)}; noise and "
            f"uncertainties explain {number(1e3 * (own.limit or 0.0), digits=2)} mm/s)"
        )
    sentence = f"{' and '.join(parts)}."
    if not found.suspects:
        return f"{_capital(sentence)} No constant explains it: the friction is another one."
    suspected = [_last_bias(item) for item in found.suspects[:SUSPECTS]]
    return f"{_capital(sentence)} It would be explained if this were so: {'; or '.join(suspected)}."


def _last_bias(item: Attempt) -> str:
    """Return the sentence of an attempt on the constant beside those of the drive."""
    return bias(item, item.names[-1]).sentence.rstrip(".")


def _equal(found: Search) -> list[str]:
    """Return what would explain the recording as well as what is reported."""
    if not found.equal:
        return []
    own = set(found.found.names)
    others = [
        bias(item, name).sentence.rstrip(".")
        for item in found.equal
        for name in item.names
        if name not in own
    ]
    return [f"The motion cannot separate it from: {'; or '.join(others)}."]


def _extrapolated(trials: Sequence[ValidatedTrial], friction: Friction) -> list[str]:
    beyond = sum(bool(trial.note) for trial in trials)
    if not beyond or friction.visited_m_s is None:
        return []
    low, high = (number(1e3 * end, digits=3) for end in friction.visited_m_s)
    return [
        f"In {beyond} of {_count(len(trials))} the slip goes beyond the {low} to {high} mm/s that "
        "identified the model: there it is tried as an extrapolation."
    ]


def _named(trial: ValidatedTrial) -> str:
    return ", ".join(trial.conditions[name] for name in ("mass", "current"))


def _excess(item: Deviation) -> float:
    return item.rms / item.limit if item.limit else 0.0


def _mm(item: Deviation) -> str:
    return f"{number(1e3 * item.rms, places_for(1e3 * item.rms))} mm/s"


def _count(trials: int) -> str:
    return "1 trial" if trials == 1 else f"{trials} trials"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
