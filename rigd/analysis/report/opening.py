"""Makes the two sentences at the top of a report: which results may be used, which not, and why."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from rigd.analysis.report.rounding import number, places_for, span
from rigd.analysis.report.section import Opening, ReportSection
from rigd.analysis.result import Curve, FitOutcome, IdentificationResult, ParameterEstimate, Verdict

#: A curve whose band is wider than this share of it, either way, is not called usable.
USABLE_BAND = 0.2


def opening_of(sections: Sequence[ReportSection]) -> Opening:
    """Return the sentences on the parameters and curves of all ``sections``."""
    return Opening(
        joined([_with_label(s, sections, _usable(s.result)) for s in sections], "no number"),
        joined(_unusable(sections), "what lies beyond the range that was visited"),
    )


def joined(parts: Iterable[str], nothing: str) -> str:
    """Return ``parts`` as the end of a sentence, empty ones left out; ``nothing`` without any."""
    text = "; ".join(part for part in parts if part) or nothing
    return text if text.endswith("?") else f"{text}."


def listed(names: Sequence[str]) -> str:
    """Return ``a, b and c``."""
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)


def _usable(result: IdentificationResult) -> str:
    """Return the parameters and the curve that may be used, as text; "" if there are none."""
    if _misfit(result):
        return ""
    found = [*result.parameters, *result.derived]
    known = [item.name for item in found if item.verdict is Verdict.IDENTIFIABLE]
    rough = [item.name for item in found if item.verdict is Verdict.WEAK]
    curve = _curve(result.curve)
    parts = [*known, *(f"{name} (roughly)" for name in rough), *([curve] if curve else [])]
    return f"{listed(parts)}{_with_care(result)}" if parts else ""


def _with_care(result: IdentificationResult) -> str:
    """Return which tests the residuals do not pass; a test without p value states its share.

    A gate has judged them already, with what is known of the sensors and of the processing.
    """
    if result.gate is not None:
        return ""
    failed = [
        test.name if test.p_value is not None else f"{test.name} ({test.sentence.split(';')[0]})"
        for test in result.residual_tests
        if not test.passed
    ]
    return f", with care: the residuals do not pass {listed(failed)}" if failed else ""


def _curve(curve: Curve) -> str:
    """Return a curve with its range and band; empty if there is none, or its band is too wide."""
    band = _band(curve)
    if band is None or band > USABLE_BAND:
        return ""
    reach = span(float(np.min(curve.x)), float(np.max(curve.x)), curve.x_unit)
    share = number(100.0 * band, places_for(100.0 * band))
    return f"{curve.y_name}({curve.x_name}) from {reach} (±{share} %)"


def _band(curve: Curve) -> float | None:
    """Return half the width of the band over the curve, the median; None if there is none."""
    if not curve.x.size or not np.all(np.isfinite(curve.low)) or not np.all(curve.y):
        return None
    return float(np.median(0.5 * (curve.high - curve.low) / np.abs(curve.y)))


def _unusable(sections: Sequence[ReportSection]) -> list[str]:
    """Return what may not be used, with the reason; things with the same reason together."""
    parts = [
        f"{section.label} as a whole: {section.result.gate.sentence.rstrip('.')}"
        for section in sections
        if _misfit(section.result) and section.result.gate is not None
    ]
    by_reason: dict[str, dict[str, list[str]]] = {}
    fitting = [section for section in sections if not _misfit(section.result)]
    for section in fitting:
        for item in (*section.result.parameters, *section.result.derived):
            if not item.identifiable:
                names = by_reason.setdefault(_reason(item), {})
                names.setdefault(item.name, []).append(section.label)
        band = _band(section.result.curve)
        if band is not None and band > USABLE_BAND:
            names = by_reason.setdefault("its band is too wide", {})
            names.setdefault(section.result.curve.y_name, []).append(section.label)
    parts += [
        f"{_names_with_sections(names, len(fitting))}: {why}" for why, names in by_reason.items()
    ]
    return parts


def _reason(item: ParameterEstimate) -> str:
    return item.verdict.value


def _names_with_sections(names: Mapping[str, Sequence[str]], sections: int) -> str:
    """Return the names as text, each group of them with the labels of its sections in brackets.

    ``names`` maps a name to the labels; names with the same labels are one group. There are no
    brackets if the report has one section.
    """
    together: dict[tuple[str, ...], list[str]] = {}
    for name, labels in names.items():
        together.setdefault(tuple(labels), []).append(name)
    return ", ".join(
        listed(found) + ("" if sections == 1 else f" ({_section_list(labels, sections)})")
        for labels, found in together.items()
    )


def _section_list(labels: Sequence[str], sections: int) -> str:
    return "all" if len(labels) == sections else ", ".join(labels)


def _with_label(section: ReportSection, sections: Sequence[ReportSection], text: str) -> str:
    return f"{section.label}: {text}" if text and len(sections) > 1 else text


def _misfit(result: IdentificationResult) -> bool:
    return result.gate is not None and result.gate.outcome is FitOutcome.MISFIT
