"""Reads the setpoints of a step as profiles, and checks every value against the rig's limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from rigd.config.document import KeyPath
from rigd.config.problems import suggest
from rigd.config.quantities import rate_unit
from rigd.config.rig import RigConfig
from rigd.model.limits import SetpointLimit, rounded_to
from rigd.model.units import format_quantity
from rigd.procedure.expression import Scope
from rigd.procedure.profiles.profile_source import (
    ChirpSource,
    PrbsSource,
    ProfileSource,
    RampSource,
    SineSource,
    SquareSource,
    TableProfileSource,
)
from rigd.procedure.profiles.profiles import (
    Chirp,
    ConstantProfile,
    Prbs,
    Profile,
    Ramp,
    Sine,
    Square,
    TableProfile,
)
from rigd.procedure.reader import Reader


@dataclass(frozen=True)
class SetpointReader:
    """Reads the profile of one setpoint; problems are noted in ``reader``.

    People write its values in the unit ``display``.
    """

    reader: Reader
    path: KeyPath
    name: str
    unit: str
    display: str
    limit: SetpointLimit
    scope: Scope

    def profile(self, source: str | ProfileSource) -> Profile | None:
        """Return the profile, or None with the problem noted."""
        if isinstance(source, str):
            return ConstantProfile(self._level((), source))
        given = [key for key in ProfileSource.model_fields if getattr(source, key) is not None]
        if len(given) != 1:
            kinds = ", ".join(ProfileSource.model_fields)
            self.reader.note(self.path, f"expected exactly one profile, found {len(given)}",
                             f"give one of {kinds}")  # fmt: skip
            return None
        key = given[0]
        part = getattr(source, key)
        if isinstance(part, RampSource):
            return self._ramp(part)
        if isinstance(part, SineSource):
            return self._sine(part)
        if isinstance(part, SquareSource):
            offset, amplitude = self._swing(key, part.offset, part.amplitude)
            frequency = self._positive((key, "frequency"), part.frequency, "Hz")
            return Square(amplitude, frequency, offset)
        if isinstance(part, ChirpSource):
            return self._chirp(part)
        if isinstance(part, PrbsSource):
            offset, amplitude = self._swing(key, part.offset, part.amplitude)
            bit_s = self._positive((key, "bit"), part.bit, "s")
            return Prbs(amplitude, bit_s, part.order, offset, part.seed)
        return self._table(part)

    def _ramp(self, source: RampSource) -> Ramp:
        start = None if source.start is None else self._level(("ramp", "from"), source.start)
        end = self._level(("ramp", "to"), source.to)
        over = self._positive(("ramp", "over"), source.over, "s")
        if start is not None:
            self._check_rate(("ramp",), abs(end - start) / over)
        return Ramp(start, end, over)

    def _sine(self, source: SineSource) -> Sine:
        offset, amplitude = self._swing("sine", source.offset, source.amplitude)
        frequency = self._positive(("sine", "frequency"), source.frequency, "Hz")
        phase = self._number(("sine", "phase"), source.phase, "rad")
        self._check_rate(("sine",), 2 * math.pi * frequency * abs(amplitude))
        fade = math.inf
        if source.fade is not None:
            fade = self._positive(("sine", "fade"), source.fade, "s")
        return Sine(amplitude, frequency, offset, phase, fade)

    def _chirp(self, source: ChirpSource) -> Chirp:
        offset, amplitude = self._swing("chirp", source.offset, source.amplitude)
        start = self._positive(("chirp", "from"), source.start, "Hz")
        end = self._positive(("chirp", "to"), source.to, "Hz")
        over = self._positive(("chirp", "over"), source.over, "s")
        self._check_rate(("chirp",), 2 * math.pi * max(start, end) * abs(amplitude))
        return Chirp(amplitude, start, end, over, offset, source.spacing == "logarithmic")

    def _table(self, source: TableProfileSource) -> TableProfile | None:
        path = ("table", "times")
        times = tuple(
            self._number((*path, index), text, "s") for index, text in enumerate(source.times)
        )
        values = tuple(
            self._level(("table", "values", index), text)
            for index, text in enumerate(source.values)
        )
        if len(times) != len(values):
            self.reader.note((*self.path, *path), f"{len(times)} times for {len(values)} values",
                             "give one value for each time")  # fmt: skip
            return None
        if times[0] != 0 and not math.isnan(times[0]):
            self.reader.note((*self.path, *path, 0), "the first time is not 0 s",
                             "begin the table with the value at the start of the step")  # fmt: skip
        pairs = list(zip(times, values, strict=True))
        for index, ((t0, v0), (t1, v1)) in enumerate(pairwise(pairs), 1):
            if t1 <= t0:
                message = f"time {t1:g} s does not follow {t0:g} s"
                self.reader.note((*self.path, *path, index), message, "give rising times")
            elif not source.hold:
                self._check_rate(("table", "values", index), abs(v1 - v0) / (t1 - t0))
        return TableProfile(times, values, source.hold)

    def _swing(self, key: str, offset: str | None, amplitude: str) -> tuple[float, float]:
        """Return offset and amplitude; check that both extremes are within the limits."""
        middle = 0.0 if offset is None else self._number((key, "offset"), offset, self.display)
        half = self.reader.difference(
            (*self.path, key, "amplitude"), amplitude, self.unit, self.scope
        )
        ends = middle - half, middle + half
        for end in ends:
            self._limited((key, "amplitude"), end)
        if min(ends) < self.limit.low or max(ends) > self.limit.high:  # by rounding, or noted
            room = min(self.limit.high - middle, middle - self.limit.low)
            half = math.copysign(math.nextafter(room, 0.0), half)
        return middle, half

    def _level(self, path: KeyPath, text: str) -> float:
        return self._limited(path, self._number(path, text, self.display))

    def _number(self, path: KeyPath, text: str, unit: str) -> float:
        return self.reader.number((*self.path, *path), text, unit, self.scope)

    def _positive(self, path: KeyPath, text: str, unit: str) -> float:
        value = self._number(path, text, unit)
        if value <= 0:
            self.reader.note((*self.path, *path), f"{text} must be above 0 {unit}")
            return math.nan
        return value

    def _limited(self, path: KeyPath, value: float) -> float:
        """Return ``value``, at a limit if rounding has brought it beyond; else note what is."""
        low, high = self.limit.low, self.limit.high
        value = rounded_to(low, value, high)
        if value < low or value > high:
            side, bound = ("below", low) if value < low else ("above", high)
            self.reader.note(
                (*self.path, *path),
                f"{self.name} {format_quantity(value, self.display)} is {side} the rig's limit of "
                f"{format_quantity(bound, self.display)}",
                "change the value, or the limit in the rig file",
            )
        return value

    def _check_rate(self, path: KeyPath, rate: float) -> None:
        """Note a profile that the limiter would change: the recording would not show its shape."""
        if rate > self.limit.rate * (1 + 1e-9):
            unit = rate_unit(self.unit)
            self.reader.note(
                (*self.path, *path),
                f"{self.name} would change by {format_quantity(rate, unit)}, faster than the "
                f"rig's limit of {format_quantity(self.limit.rate, unit)}",
                "make it slower, or raise the rate in the rig file",
            )


def read_setpoint(
    reader: Reader,
    path: KeyPath,
    name: str,
    source: str | ProfileSource,
    scope: Scope,
    rig: RigConfig,
) -> Profile | None:
    """Return the profile of the setpoint called ``name``, or None with the problem noted."""
    full = rig.setpoint_name(name)
    setpoint = rig.setpoint(full)
    device, _, short = full.partition(".")
    if setpoint is None:
        if rig.channel(name) is not None:
            message = f"{name!r} is measured by the rig {rig.name}, not commanded"
            reader.note_key(path, message, suggest(name, rig.settable))
        else:
            place = reader.document.key_place(path)
            reader.problems.add_lacking(place, rig.name, "setpoint", name, rig.settable)
        return None
    if name in rig.loops:
        reader.note_key(path, f"{name} belongs to the controller {device}", f"write '{device}'")
    limit = rig.devices[device].limits[short]
    shown = setpoint.shown_in
    return SetpointReader(reader, path, name, setpoint.unit, shown, limit, scope).profile(source)
