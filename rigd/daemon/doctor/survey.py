"""Measures every stream of a rig at rest: rate, stale (repeated) rows, zero and noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.computed.controllers.driver import ControllerConfig
from rigd.computed.derived.driver import DerivedConfig
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.daemon.doctor.bare_cycle import Lateness
from rigd.daemon.doctor.check import Check, CheckVerdict
from rigd.daemon.doctor.statistics import Statistics
from rigd.daemon.doctor.timing import lateness_check, silence_check
from rigd.engine.cycle.mount import CYCLE_STREAM
from rigd.engine.cycle.wiring import in_cycle
from rigd.engine.row_rates import most_rows_hz
from rigd.engine.sink import Rows
from rigd.model.channels import STALE, STATUS_FIELD, Channel
from rigd.model.rows import TIME_FIELD
from rigd.model.units import format_difference, format_quantity
from rigd.sdk import BlockDriver, Driver

#: A rate may differ from the declared rate by this share of it.
_RATE_TOLERANCE: Final = 0.01
#: Shares of stale rows: above the first a warning, above the second a failure.
_STALE_WARN: Final = 1e-3
_STALE_FAIL: Final = 0.5
#: A cycle that takes more than this share of its period may delay the next.
_BUSY_SHARE: Final = 0.6


class Survey:
    """Collects the rows of ``rig`` and returns checks of them."""

    def __init__(self, rig: RigConfig) -> None:
        self._rig = rig
        self._count = dict.fromkeys(rig.devices, 0)
        self._stale = dict.fromkeys(rig.devices, 0)
        self._first_ns: dict[str, int] = {}
        self._last_ns: dict[str, int] = {}
        self._channels = {
            (name, channel.name): Statistics()
            for name, device in rig.devices.items()
            for channel in device.channels
        }
        self._cycles: list[Rows] = []

    def take(self, stream: str, rows: Rows) -> None:
        """Add rows of one stream, in time order, at least one row."""
        if stream == CYCLE_STREAM.name:
            self._cycles.append(rows)
            return
        self._first_ns.setdefault(stream, int(rows[TIME_FIELD][0]))
        self._last_ns[stream] = int(rows[TIME_FIELD][-1])
        self._count[stream] += len(rows)
        if STATUS_FIELD in (rows.dtype.names or ()):
            fresh = rows[STATUS_FIELD] & STALE == 0
            self._stale[stream] += len(rows) - int(fresh.sum())
            rows = rows[fresh]
        for channel in self._rig.devices[stream].channels:
            self._channels[stream, channel.name].add(rows[channel.name])

    def cycle(self, group: str, watchdogs: Mapping[str, float]) -> Iterator[Check]:
        """Yield how the cycle kept its time with the devices in it; see :func:`silence_check`."""
        if sum(map(len, self._cycles)) < 2:
            yield Check(group, "cycle", CheckVerdict.FAIL, "no cycle has run")
            return
        rows = np.concatenate(self._cycles)
        period_ns = self._rig.period_ns
        late = Lateness.of(rows["scheduled"], rows["actual"], period_ns * 1e-9)
        yield lateness_check(group, f"cycle at {1e9 / period_ns:g} Hz", late, period_ns)
        yield self._work(group, rows["spent"])
        yield silence_check(group, late, self._rig, watchdogs)

    @property
    def share(self) -> float | None:
        """What a cycle takes of the processor, 0 to 1, by the p99; None if none has run."""
        if not self._cycles:
            return None
        spent_s = np.concatenate(self._cycles)["spent"]
        return float(np.quantile(spent_s, 0.99)) / (self._rig.period_ns * 1e-9)

    def _work(self, group: str, spent_s: NDArray[np.float64]) -> Check:
        p50_s, p99_s = (float(item) for item in np.quantile(spent_s, [0.5, 0.99]))
        period_s = self._rig.period_ns * 1e-9
        found = (
            f"takes {p50_s * 1e6:.0f} us (p50), {p99_s * 1e6:.0f} us (p99) of {period_s * 1e6:g} us"
        )
        figures = {"spent_s": {"p50": p50_s, "p99": p99_s}, "period_s": period_s}
        if p50_s > _BUSY_SHARE * period_s:
            advice = "lower `cycle`, or use a faster machine: the exchange hardly fits"
            return Check(group, "work per cycle", CheckVerdict.WARN, found, advice, figures)
        return Check(group, "work per cycle", CheckVerdict.OK, found, figures=figures)

    def devices(self, group: str) -> Iterator[Check]:
        """Yield the rate and the stale rows of every device."""
        for device in self._rig.devices.values():
            if device.channels:
                yield self._device(group, device)

    def _device(self, group: str, device: DeviceConfig) -> Check:
        name = device.name
        count, stale = self._count[name], self._stale[name]
        took_s = (self._last_ns.get(name, 0) - self._first_ns.get(name, 0)) * 1e-9
        if count < 2 or took_s <= 0:
            advice = "measure longer, with --seconds" if count else "is it on, and does it measure?"
            verdict = CheckVerdict.WARN if count else CheckVerdict.FAIL
            return Check(group, name, verdict, f"{count} rows", advice)
        rate_hz, share = (count - 1) / took_s, stale / count
        found = f"{rate_hz:.5g} rows/s" + (f", {stale} of {count} stale" if stale else "")
        figures = {"rate_hz": rate_hz, "rows": count, "stale": stale}
        if share > _STALE_WARN:
            verdict = CheckVerdict.FAIL if share > _STALE_FAIL else CheckVerdict.WARN
            advice = "its answers come late: a busy bus or line, or a busy machine"
            return Check(group, name, verdict, found, advice, figures)
        wanted_hz = self._wanted_hz(device)
        if wanted_hz is not None and rate_hz < (1 - _RATE_TOLERANCE) * wanted_hz:
            advice = f"it should give {wanted_hz:g} rows/s: rows were lost on their way"
            return Check(group, name, CheckVerdict.WARN, found, advice, figures)
        return Check(group, name, CheckVerdict.OK, found, figures=figures)

    def _wanted_hz(self, device: DeviceConfig) -> float | None:
        """Return the rate that a device must keep; None if it has its own rate."""
        kind = device.driver_class
        steady = issubclass(kind, BlockDriver) or (
            issubclass(kind, Driver) and device.declaration.every_cycle
        )
        return most_rows_hz(self._rig, device.stream) if steady else None

    def channels(self, group: str) -> Iterator[Check]:
        """Yield zero and noise of every channel."""
        for device in self._rig.devices.values():
            for channel in device.channels:
                seen = self._channels[device.name, channel.name]
                yield judge_channel(group, device, channel, seen)


def _unknown(check: Check, group: DerivedConfig) -> Check:
    """Return the ``check`` of a derived channel that has no value at times: no device is broken.

    A device that gives none fails by its own channel.
    """
    if group.graph.is_conditional(check.name):
        return replace(check, found=f"{check.found}: its `where` or `hold` does not hold")
    advice = (
        "its formula has no value there: a division by 0, a root of a negative number, a value "
        "outside a table, or a channel in it that fails above?"
    )
    return replace(check, verdict=CheckVerdict.WARN, advice=advice)


def judge_channel(group: str, device: DeviceConfig, channel: Channel, seen: Statistics) -> Check:
    """Return the check of a channel that was watched at rest."""
    name = f"{device.name}.{channel.name}"
    if seen.not_finite:
        total = seen.count + seen.not_finite
        found = f"{seen.not_finite} of {total} values are not a number"
        if isinstance(device.config, DerivedConfig):
            return _unknown(Check(group, name, CheckVerdict.OK, found), device.config)
        advice = "beyond its range, or its sensor is not connected?"
        return Check(group, name, CheckVerdict.FAIL, found, advice)
    if not seen.count:
        return Check(
            group, name, CheckVerdict.FAIL, "no value", "see the check of its device above"
        )
    figures = {
        "unit": channel.unit,
        "zero": seen.mean,
        "noise": None if math.isnan(seen.deviation) else seen.deviation,
        "low": seen.low,
        "high": seen.high,
    }
    if seen.count > 2 and seen.climbing:
        found = "its value only rises"
        return Check(group, name, CheckVerdict.OK, found, figures=figures)
    found = f"zero {format_quantity(seen.mean, channel.shown_in, 4)}, "
    if seen.constant:
        found += "constant"
    elif not math.isnan(seen.deviation):
        found += f"noise {format_difference(seen.deviation, channel.shown_in, 3)}"
    else:
        found += "one value"
    limit = device.limits.get(channel.name)
    rests = limit is not None and seen.low == limit.rest == seen.high  # an open relay reads 0
    rests = rests or isinstance(device.config, ControllerConfig)  # all are at an end, or at 0
    if not rests and (seen.low <= channel.low or seen.high >= channel.high):
        end = channel.low if seen.low <= channel.low else channel.high
        shown = format_quantity(end, channel.shown_in)
        advice = f"it is at the end of its range, {shown}: saturated, or a wire is loose?"
        return Check(group, name, CheckVerdict.WARN, found, advice, figures)
    analogue = issubclass(device.driver_class, BlockDriver) and not in_cycle(device)
    if seen.constant and analogue and channel.raw_of is not None:
        advice = "an analogue input without any noise: is its sensor connected, and on?"
        return Check(group, name, CheckVerdict.WARN, found, advice, figures)
    return Check(group, name, CheckVerdict.OK, found, figures=figures)
