"""Decides whether the results of a fit may be reported, from the misfit and what explains it.

There are three outcomes:

- the model fits;
- the model fits after a change that the report names: the data correct a constant, or something is
  added to the model; the reported numbers are those after the change;
- the model does not fit: no number of it may be reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rigd.analysis.output_error.diagnosis import Diagnosis
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import Explanation, FitOutcome, Gate, Meaning

DOUBLED = 0.05  #: relative difference of a factor of two that is still one
MOST = 4  #: findings that are given
#: How a refusal begins if what explains a misfit leaves the parameters without a meaning.
REFUSED = {
    Meaning.LAW: "The friction is not that of the model: these data show",
    Meaning.CONFUSED: "No number is given, as these data show what cannot be told from friction:",
}


def judge_fit(diagnosis: Diagnosis, labels: Sequence[str], period_s: float) -> Gate:
    """Return whether the numbers of the last fit of ``diagnosis`` may be given.

    ``labels`` (trials,) name the trials, whose samples are ``period_s`` apart.
    """
    unexplained = _unexplained(diagnosis, labels)
    explained = diagnosis.explanations
    if unexplained:
        explained = tuple(map(_rough, explained))
    contradicted = [item for item in explained if abs(item.pull) > THRESHOLDS.max_pull]
    laws = [item for item in explained if item.meaning in REFUSED]
    decisive = [] if unexplained else [*contradicted, *laws][:1]
    first = sorted(explained, key=lambda item: item not in decisive)  # what the outcome rests on
    sentences = [sentence(item) for item in first]
    lead = ""
    if decisive and explained[0] is not decisive[0]:  # the largest is looked at first
        lead = f"Most of the misfit is {sentence(explained[0])} Beside that: "
    left = _left(diagnosis, labels, period_s)
    findings = tuple([*unexplained[:1], *sentences, *left, *unexplained[1:]][:MOST])
    if contradicted and not unexplained:
        text = f"{lead}The model does not fit these data as the rig is stated: {sentences[0]}"
        return Gate(FitOutcome.MISFIT, text, findings, explained)
    if unexplained:
        text = f"The model does not fit these data: {unexplained[0]}"
        if sentences:
            text += f" What explains most of it, though not all, is {sentences[0]}"
        else:
            shape = _shape(diagnosis, labels, period_s)
            text += f" Nothing that rigd knows explains most of it. {shape}"
        return Gate(FitOutcome.MISFIT, text, findings, explained)
    if laws:
        text = f"{lead}{REFUSED[laws[0].meaning]} {sentences[0]}"
        return Gate(FitOutcome.MISFIT, text, findings, explained)
    if explained:
        text = f"The model fits these data with {sentences[0]}"
        return Gate(FitOutcome.CORRECTED, text, findings, explained)
    if left:
        text = f"The model fits these data nearly; the intervals are widened: {left[0]}"
        return Gate(FitOutcome.CORRECTED, text, findings)
    return Gate(FitOutcome.FITS, "The model fits these data within the noise of the sensors.")


def strained_gate(gate: Gate, strained: Explanation | None) -> Gate:
    """Return ``gate``, without numbers if what they rest on is ``strained``."""
    if strained is None or gate.outcome is FitOutcome.MISFIT:
        return gate
    text = (
        "No number is given: these data move a constant that the result rests on farther than "
        f"chance does. They show {sentence(strained)}"
    )
    return Gate(FitOutcome.MISFIT, text, (text, *gate.findings), (strained, *gate.explanations))


def settled_gate(gate: Gate, why: str, advice: str = "") -> Gate:
    """Return ``gate``, without numbers if the fit has not come to its end.

    ``why`` is what keeps it, empty if nothing does; ``advice`` is a sentence on what to do.
    """
    if not why or gate.outcome is FitOutcome.MISFIT:
        return gate
    text = " ".join(filter(None, [f"No number is given: {why}.", advice]))
    return Gate(FitOutcome.MISFIT, text, (why, *gate.findings), gate.explanations)


def sentence(item: Explanation) -> str:
    """Return what explains a misfit, its size, and what to check."""
    unit = "" if item.unit == "1" else f" {item.unit}"
    size = f"{item.size:.4g}"
    sd = f" ± {item.sd:.1g}"
    if item.stated is None:
        text = f"{item.name}: {size}{sd}{unit}"
    else:
        text = f"another {item.name}: {size}{sd}{unit}, stated {item.stated:.6g}{unit}"
        text += _typed(item)
    other = f" (or: {'; '.join(item.others)})" if item.others else ""
    look = f". Look at {item.look}" if item.look else ""
    return f"{text}{other}{look}."


def _rough(item: Explanation) -> Explanation:
    """Return ``item`` of a fit that leaves more than noise: its size is known to a factor of 2."""
    return replace(item, sd=max(item.sd, abs(item.size - (item.stated or 0.0))))


def _typed(item: Explanation) -> str:
    """Return a guess at a typing error of a radius."""
    if not item.size or item.stated is None or "radius" not in item.name:
        return ""
    factor = item.stated / item.size
    if abs(factor - 2.0) < DOUBLED:
        return " (twice as much: a diameter typed for a radius?)"
    if abs(factor - 0.5) < 0.5 * DOUBLED:
        return " (half as much: a radius typed for a diameter?)"
    return ""


def _unexplained(diagnosis: Diagnosis, labels: Sequence[str]) -> list[str]:
    """Return a sentence on each output that is off by more than noise, the worst first.

    All that was added is in the model then.
    """
    found: list[tuple[float, str]] = []
    outputs = diagnosis.fit.model.system.outputs
    for output, level, worst, trial in zip(
        outputs, diagnosis.levels, diagnosis.worst, diagnosis.trials, strict=True
    ):
        if level > THRESHOLDS.max_mean_square_output or worst > THRESHOLDS.max_mean_square_trial:
            text = (
                f"its {output.name} is off by {level**0.5:.1f} times what the noise of input and "
                f"sensors leaves, by {worst**0.5:.1f} times in trial {labels[trial]}."
            )
            found.append((level, text))
    return [text for _, text in sorted(found, key=lambda item: -item[0])]


def _shape(diagnosis: Diagnosis, labels: Sequence[str], period_s: float) -> str:
    """Return what a misfit without a known cause looks like: when, how fast, with what."""
    shape = diagnosis.shape
    found = (
        f"Half of it is in trial {labels[shape.trial]} between {1e3 * shape.begin * period_s:.0f} "
        f"and {1e3 * shape.end * period_s:.0f} ms from its begin, mostly below "
        f"{max(shape.frequency / period_s, 1.0):.0f} Hz"
    )
    suspects = [item.candidate for item in diagnosis.left if item.candidate is not None]
    with_it = next((suspect.context for suspect in suspects if suspect.context), "")
    return f"{found}, and it goes with {with_it}." if with_it else f"{found}."


def _left(diagnosis: Diagnosis, labels: Sequence[str], period_s: float) -> list[str]:
    """Return a sentence on each thing that is significant still, but small."""
    outputs = diagnosis.fit.model.system.outputs
    found = [f"what is left is small, and most like {x.name}." for x in diagnosis.left[:MOST]]
    band, jump = diagnosis.band, diagnosis.jump
    if diagnosis.coloured and band.p_value <= jump.p_value:
        found.append(
            f"its {outputs[band.output].name} shows {band.ratio**0.5:.1f} times its noise from "
            f"{band.low_hz:.0f} to {band.high_hz:.0f} Hz."
        )
    elif diagnosis.coloured:
        found.append(
            f"its {outputs[jump.output].name} jumps by {jump.size:.0f} standard deviations in "
            f"trial {labels[jump.trial]}, {1e3 * jump.sample * period_s:.0f} ms from its begin."
        )
    return found
