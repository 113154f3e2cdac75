"""Checks the timing of the cycle: how late cycles begin, and how long the cycle may be silent.

After the silence ``cycle_silence`` of the rig file, the cycle counts as dead. This time must be
well above the longest gap between two cycles, and so must every other time after which a stall
ends a run: watchdogs of devices, and ``stale_after`` of interlocks and controllers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from types import MappingProxyType
from typing import Final

from rigd.computed.controllers.driver import ControllerConfig
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


def silence_check(
    group: str,
    late: Lateness,
    rig: RigConfig | None,
    watchdogs: Mapping[str, float] = MappingProxyType({}),
) -> Check:
    """Return whether what ends a run after a silence is well above the gaps of a cycle that lives.

    ``watchdogs`` has the seconds after which each made its device safe when it was tested.
    """
    wanted_s = suggested_silence_s(late.longest_gap_s)
    found = f"longest gap between two cycles {late.longest_gap_s * 1e3:.3g} ms"
    figures: dict[str, object] = {
        "longest_gap_s": late.longest_gap_s,
        "suggested_cycle_silence_s": wanted_s,
    }
    if rig is None:
        found += f"; `cycle_silence: {wanted_s * 1e3:g} ms` or more suits this machine"
        return Check(group, "stalls", CheckVerdict.OK, found, figures=figures)
    silence_s = rig.supervision.cycle_silence_s
    others = sorted(_other_bounds(rig, watchdogs))
    shortest_s, key, name = min([(silence_s, "cycle_silence", ""), *others])
    found += f"; the shortest bound of this rig is {_bound(key, [name])}, {shortest_s * 1e3:.3g} ms"
    least_s = _SILENCE_FACTOR * late.longest_gap_s
    advice = []
    if silence_s < least_s:
        advice.append(
            f"a stall would be taken for a death: write `cycle_silence: {wanted_s * 1e3:g} ms` "
            "under `supervision:`"
        )
    short = [item for item in others if item[0] < least_s]
    if short:
        names = ", ".join(
            f"{_bound(key, [item[2] for item in items])} ({bound_s * 1e3:.3g} ms)"
            for (bound_s, key), items in groupby(short, lambda item: item[:2])
        )
        advice.append(
            f"a stall would end a run by {names}: find what stalls this machine, or give "
            f"{wanted_s * 1e3:g} ms where that is safe"
        )
    verdict = CheckVerdict.WARN if advice else CheckVerdict.OK
    return Check(group, "stalls", verdict, found, "; ".join(advice), figures)


def _other_bounds(
    rig: RigConfig, watchdogs: Mapping[str, float]
) -> Iterator[tuple[float, str, str]]:
    """Yield the other silences that end a run: seconds, what they are, and of what."""
    for name, safe_after_s in watchdogs.items():
        yield safe_after_s, "watchdog", name
    if rig.plant is not None:
        return  # its rows are made in the cycle: none is old after a gap
    for device in rig.devices.values():
        if isinstance(device.config, ControllerConfig):
            yield device.config.stale_s, "stale_after", device.name
    for interlock in rig.interlocks:
        yield interlock.stale_after_s, "stale_after", interlock.name


def _bound(key: str, names: Iterable[str]) -> str:
    of = ", ".join(filter(None, names))
    return f"`{key}` of {of}" if of else f"`{key}`"


def suggested_silence_s(longest_gap_s: float) -> float:
    """Return the shortest usual silence, in s, that is well above ``longest_gap_s``."""
    least_s = _SILENCE_FACTOR * longest_gap_s
    return next((silence for silence in _SILENCES if silence >= least_s), least_s)


def _us(seconds: float) -> str:
    return f"{seconds * 1e6:.0f} us" if seconds < 1e-3 else f"{seconds * 1e3:.3g} ms"
