"""Checks the timing of the cycle: how late cycles begin, and how long the cycle may be silent.

After the silence ``cycle_silence`` of the rig file, the cycle counts as dead. This time must be
well above the longest gap between two cycles.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from rigd.config.rig import RigConfig
from rigd.daemon.doctor.bare_cycle import BareCycle, Lateness, measure
from rigd.daemon.doctor.check import Check, CheckVerdict

_GROUP: Final = "timing"
#: Rate of the bare cycle if no rig gives one.
DEFAULT_PERIOD_NS: Final = 1_000_000
#: Shares of missed cycles: above the first a warning (some are normal on a shared machine), above
#: the second a failure: the recordings would have too many stale rows.
_MISSED_WARN: Final = 3e-4
_MISSED_FAIL: Final = 0.05
#: ``cycle_silence`` should be so many times the longest measured gap between two cycles.
_SILENCE_FACTOR: Final = 2.0
#: Rounded values to suggest for it, in s.
_SILENCES: Final = (0.05, 0.1, 0.15, 0.25, 0.5, 1.0, 2.0)


def examine_timing(rig: RigConfig | None, seconds: float) -> Iterator[Check]:
    """Run a bare cycle; yield the granted settings and the delays."""
    period_ns = DEFAULT_PERIOD_NS if rig is None else rig.period_ns
    found = measure(period_ns, seconds)
    yield from _granted(found)
    yield lateness_check(_GROUP, f"cycle at {1e9 / period_ns:g} Hz", found.lateness, period_ns)
    yield silence_check(_GROUP, found.lateness, rig)


def _granted(found: BareCycle) -> Iterator[Check]:
    if found.granted:
        yield Check(_GROUP, "granted", CheckVerdict.OK, ", ".join(found.granted))
    for sentence in found.lost:
        what, _, advice = sentence.partition(": ")
        yield Check(_GROUP, "not granted", CheckVerdict.WARN, what, advice)


def lateness_check(group: str, name: str, late: Lateness, period_ns: int) -> Check:
    """Return the verdict on ``late`` cycles of a rig with this period."""
    share = late.missed / (late.cycles + late.missed)
    found = (
        f"late by {_us(late.p50_s)} (p50), {_us(late.p99_s)} (p99), {_us(late.p999_s)} (p99.9), "
        f"{_us(late.max_s)} (max); {late.missed} of {late.cycles + late.missed} missed"
    )
    figures = {
        "cycles": late.cycles,
        "missed": late.missed,
        "late_s": {"p50": late.p50_s, "p99": late.p99_s, "p99.9": late.p999_s, "max": late.max_s},
    }
    if share > _MISSED_FAIL:
        advice = "recordings at this rate cannot be trusted: lower `cycle`, or use another machine"
        return Check(group, name, CheckVerdict.FAIL, found, advice, figures)
    if share > _MISSED_WARN or late.p99_s > period_ns * 1e-9:
        advice = (
            "something stalls this machine: other programs, power saving, or its host. A recording "
            "shows each missed cycle"
        )
        return Check(group, name, CheckVerdict.WARN, found, advice, figures)
    return Check(group, name, CheckVerdict.OK, found, figures=figures)


def silence_check(group: str, late: Lateness, rig: RigConfig | None) -> Check:
    """Return whether the rig's ``cycle_silence`` is well above the gaps of a cycle that lives."""
    wanted_s = suggested_silence_s(late.longest_gap_s)
    found = f"longest gap between two cycles {late.longest_gap_s * 1e3:.3g} ms"
    figures: dict[str, object] = {
        "longest_gap_s": late.longest_gap_s,
        "suggested_cycle_silence_s": wanted_s,
    }
    if rig is None:
        found += f"; `cycle_silence: {wanted_s * 1e3:g} ms` or more suits this machine"
        return Check(group, "stalls", CheckVerdict.OK, found, figures=figures)
    set_s = rig.supervision.cycle_silence_s
    found += f"; this rig allows {set_s * 1e3:g} ms"
    if set_s < _SILENCE_FACTOR * late.longest_gap_s:
        advice = (
            f"a stall would be taken for a death: write `cycle_silence: {wanted_s * 1e3:g} ms` "
            "under `supervision:`"
        )
        return Check(group, "stalls", CheckVerdict.WARN, found, advice, figures)
    return Check(group, "stalls", CheckVerdict.OK, found, figures=figures)


def suggested_silence_s(longest_gap_s: float) -> float:
    """Return the shortest usual silence, in s, that is well above ``longest_gap_s``."""
    least_s = _SILENCE_FACTOR * longest_gap_s
    return next((silence for silence in _SILENCES if silence >= least_s), least_s)


def _us(seconds: float) -> str:
    return f"{seconds * 1e6:.0f} us" if seconds < 1e-3 else f"{seconds * 1e3:.3g} ms"
