"""States which further test would determine what a fit leaves open, as far as it was computed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from rigd.analysis.fitting.identifiability import UNIDENTIFIABLE_LOG_SD, WEAK_LOG_SD, Z_95, log_sd
from rigd.analysis.result import (
    FitOutcome,
    FurtherTest,
    IdentificationResult,
    ParameterEstimate,
    Verdict,
)
from rigd_analyses.lugre.design.outlook import LIGHT, Outlook
from rigd_analyses.lugre.design.subject import QUANTITIES, slip_of
from rigd_analyses.lugre.rig.standard_errors import RigIdentification

SLIPS = ("g@5mm/s", "g@10mm/s", "g@20mm/s", "g@50mm/s")  #: at which g is asked for
OPEN = (Verdict.UNIDENTIFIABLE, Verdict.WEAK, Verdict.CONSTANTS)
TIMES = ("", ", twice", ", three times", ", four times")
MENTIONED = 3.0  #: half width of a logarithm beyond which it is no more than open


def with_further_tests(
    result: IdentificationResult, found: RigIdentification
) -> IdentificationResult:
    """Return ``result`` with what further tests would make of all that it leaves open."""
    every = (*result.parameters, *result.derived)
    verdicts = {item.name: item.verdict for item in every if item.verdict in OPEN}
    verdicts |= dict.fromkeys(open_slips(result), Verdict.UNIDENTIFIABLE)
    if found.gate.outcome is FitOutcome.MISFIT or not verdicts:
        return result
    tests = {item.target: item for item in _tests(Outlook(found), verdicts)}

    def advised(entry: ParameterEstimate) -> ParameterEstimate:
        return replace(entry, advice=tests[entry.name].sentence) if entry.name in tests else entry

    note = [f"{slip}: {tests[slip].sentence}" for slip in SLIPS if slip in tests]
    return replace(
        result,
        parameters=tuple(advised(entry) for entry in result.parameters),
        derived=tuple(advised(entry) for entry in result.derived),
        curve=replace(result.curve, note=" ".join([result.curve.note, *note])),
        further=tuple(tests.values()),
    )


def open_slips(result: IdentificationResult) -> Iterator[str]:
    """Yield the slips at which g is not known to a factor of two."""
    curve = result.curve
    for name in SLIPS:
        at = slip_of(name)
        if at is None or not (len(curve.x) and curve.x[0] <= at <= curve.x[-1]):
            yield name
            continue
        low, high = (float(np.interp(at, curve.x, ends)) for ends in (curve.low, curve.high))
        if log_sd(low, high) > UNIDENTIFIABLE_LOG_SD:
            yield name


def _tests(outlook: Outlook, verdicts: Mapping[str, Verdict]) -> Iterator[FurtherTest]:
    for name, verdict in verdicts.items():
        goal = WEAK_LOG_SD if verdict is Verdict.WEAK else UNIDENTIFIABLE_LOG_SD
        found = _best(outlook, name, Z_95 * goal)
        # Where constants are the reason, the sentence of the verdict names the one to measure.
        if found.count or verdict is not Verdict.CONSTANTS:
            yield found


def _best(outlook: Outlook, name: str, goal: float) -> FurtherTest:
    """Return the test that brings the half width of a logarithm to ``goal`` with fewest trials."""
    tests, most, tried = outlook.tests, len(TIMES), _tried(outlook)
    if all(outlook.beyond(name, test, outlook.best) for test in tests):
        low, high = (1e3 * end for end in outlook.slip_m_s)
        place = "it lies" if slip_of(name) else "V_s of the best fit lies"
        return FurtherTest(
            name,
            f"No further test of {tried} determines it: {place} outside of their slip, {low:.2g} "
            f"to {high:.3g} mm/s.",
        )
    at_best = [outlook.half_widths(name, test, outlook.best, most) for test in tests]
    lacking = [int(np.sum(widths > goal)) for widths in at_best]
    first = min(range(len(tests)), key=lambda k: (lacking[k], at_best[k][-1]))
    test, width = tests[first], float(at_best[first][-1])
    if lacking[first] == most:
        best = f"; at best it would be known to {_width(width)}" if width < MENTIONED else ""
        return FurtherTest(
            name, f"No further test of {tried} determines it, even if taken four times{best}."
        )
    everywhere = outlook.everywhere(name, test, most)
    certain = bool(np.any(everywhere <= goal))
    widths = everywhere if certain else at_best[first]
    short = int(np.sum(widths > goal))
    what, narrow = f"{_begun(test.words)}{TIMES[short]}", _width(float(widths[short]))
    sentence = f"{what}: predicted to determine it to {narrow}."
    if not certain:
        sentence = (
            f"{what}, may determine it: to {narrow} if friction is that of the best fit, but not "
            "with all friction that these data accept."
        )
    together = " and `--joint`, as the masses differ" if test.load != 1.0 else ""
    more = f"Identify the new recording together with these{together}."
    if name in QUANTITIES or slip_of(name):
        more += f" `rigd design --model MODEL.json --for {name}` chooses several tests."
    return FurtherTest(
        name, f"{sentence} {more}", test.words, short + 1, float(widths[short]), certain
    )


def _tried(outlook: Outlook) -> str:
    """Return which tests were computed."""
    mass = outlook.mass_kg
    kinds = f"up to {outlook.largest_a:g} A, with {mass:.3g} and {LIGHT * mass:.3g} kg"
    braking = ", braking, swings" if outlook.brakes else ""
    return f"{len(outlook.tests)} that were computed ({kinds}{braking})"


def _width(half: float) -> str:
    return f"±{100.0 * half:.2g} %" if half < 0.4 else f"a factor of {math.exp(half):.2g}"


def _begun(sentence: str) -> str:
    return sentence[0].upper() + sentence[1:]
