"""A slow second form of formulas for tests: trees, computed from the whole history of each part."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.linalg import expm

#: Names of the two-place operators and of the functions of numbers.
OPERATORS: Final = ("+", "-", "*", "/")
NAN: Final = math.nan
#: The points of each `lookup`.
TABLE: Final = ((-2.0, 0.5), (-0.25, 3.0), (0.25, -1.0), (3.0, 2.0))


@dataclass
class Part:
    """A part of a formula: ``kind``, its ``parts``, and a fixed ``number`` if it takes one."""

    kind: str
    parts: tuple[Part, ...] = ()
    number: float = 0.0
    #: (time of the newest reading in s, value) at every new reading so far.
    history: list[tuple[float, float]] = field(default_factory=list)
    held: float = NAN
    last: float = NAN

    def text(self) -> str:
        """Return the part as a formula."""
        inside = [part.text() for part in self.parts]
        match self.kind:
            case "number":
                return f"({self.number!r})"
            case "a" | "b":
                return f"dev_{self.kind}.x"
            case "channel":
                return f"d{self.number:.0f}.x"
            case "+" | "-" | "*" | "/" | "<" | "<=" | "and" | "or":
                return f"({inside[0]} {self.kind} {inside[1]})"
            case "**":
                return f"({inside[0]} ** {self.number:.0f})"
            case "sin" | "cos" | "tan":
                return f"{self.kind}({inside[0]} * 1 rad)"
            case "atan2":
                return f"(atan2({inside[0]}, {inside[1]}) / 1 rad)"
            case "lookup":
                xs, ys = zip(*TABLE, strict=True)
                return f"lookup({inside[0]}, {[*xs]}, {[*ys]})"
            case "not":
                return f"(not {inside[0]})"
            case "negative":
                return f"(-{inside[0]})"
            case "derivative":
                return f"(derivative({inside[0]}) * 1 s)"
            case "integral":
                return f"(integral({inside[0]}) / 1 s)"
            case "lowpass":
                return f"lowpass({inside[0]}, {self.number!r} Hz)"
            case "ratelimit":
                return f"ratelimit({inside[0]}, {self.number!r} 1/s)"
            case "deadband":
                return f"deadband({inside[0]}, {self.number!r})"
            case "mean" | "rms" | "highest" | "lowest" | "delay":
                return f"{self.kind}({inside[0]}, {self.number!r} s)"
        return f"{self.kind}({', '.join(inside)})"

    def newest(self, times: dict[str, float]) -> float:
        """Return the time of the newest reading in this part, in s; -inf without."""
        if self.kind in times:
            return times[self.kind]
        return max((part.newest(times) for part in self.parts), default=-math.inf)

    def oldest(self, times: dict[str, float], now_s: float) -> float:
        """Return the time of the oldest reading in this part, in s; ``now_s`` without."""
        if self.kind in times:
            return times[self.kind]
        return min((part.oldest(times, now_s) for part in self.parts), default=now_s)

    def value(self, inputs: dict[str, float], times: dict[str, float]) -> float:
        """Return the value after a cycle; call once per cycle."""
        x, y, z = (*(part.value(inputs, times) for part in self.parts), NAN, NAN, NAN)[:3]
        result = _now(self, x, y, z, inputs)
        if result is not None:
            return result if math.isfinite(result) else NAN
        now_s = self.newest(times)
        if now_s > (self.history[-1][0] if self.history else -math.inf):
            self.history.append((now_s, x))
            self.last = self._stepped(now_s)
            self.last = self.last if math.isfinite(self.last) else NAN
        return self.last

    def _stepped(self, now_s: float) -> float:
        history = self.history
        values = [value for _, value in history]
        x = values[-1]
        inside = [value for time, value in history if now_s - time < self.number - 1e-9]
        match self.kind:
            case "derivative":
                if len(_since_known(history)) == 1:
                    return 0.0
                (before_s, before), (after_s, after) = (*history[:1], *history)[-2:]
                return NAN if math.isnan(after) else (after - before) / (after_s - before_s)
            case "integral":
                known = _since_known(history)
                return sum(
                    0.5 * (before + after) * (after_s - before_s)
                    for (before_s, before), (after_s, after) in itertools.pairwise(known)
                ) if known else NAN  # fmt: skip
            case "edges":
                known = _since_known(history)
                if not known or any(math.isnan(value) for _, value in known):
                    return NAN
                pairs = itertools.pairwise(known)
                return float(sum(after > before for (_, before), (_, after) in pairs))
            case "mean":
                return sum(inside) / len(inside)
            case "rms":
                return math.sqrt(sum(value * value for value in inside) / len(inside))
            case "highest":
                return NAN if any(map(math.isnan, inside)) else max(inside)
            case "lowest":
                return NAN if any(map(math.isnan, inside)) else min(inside)
            case "delay":
                then = [value for time, value in history if time <= now_s - self.number + 1e-9]
                return then[-1] if then else values[0]
            case "ratelimit":
                if math.isnan(x) or math.isnan(self.held):
                    self.held = x
                else:
                    most = self.number * (now_s - history[-2][0])
                    self.held += min(max(x - self.held, -most), most)
                return self.held
        return _filtered(history, self.number)


def _now(part: Part, x: float, y: float, z: float, inputs: dict[str, float]) -> float | None:
    """Return the value of a part without memory of time; None for the others."""
    unknown = math.isnan(x) or math.isnan(y)
    match part.kind:
        case "number":
            return part.number
        case "a" | "b":
            return inputs[part.kind]
        case "channel":  # another channel, computed in full as its part
            return x
        case "+":
            return x + y
        case "-":
            return x - y
        case "*":
            return x * y
        case "/":
            return x / y if y else NAN
        case "negative":
            return -x
        case "abs":
            return abs(x)
        case "sqrt":
            return math.sqrt(x) if x >= 0 else NAN
        case "min" | "max":
            return NAN if unknown else (min if part.kind == "min" else max)(x, y)
        case "sin" | "cos" | "tan":
            return {"sin": math.sin, "cos": math.cos, "tan": math.tan}[part.kind](x)
        case "**":
            return math.prod([x] * int(part.number))
        case "lookup":
            for (left, low), (right, high) in itertools.pairwise(TABLE):
                if left <= x <= right:
                    return low + (high - low) * (x - left) / (right - left)
            return NAN
        case "atan2":
            return NAN if unknown else math.atan2(x, y)
        case "<":
            return NAN if unknown else float(x < y)
        case "<=":
            return NAN if unknown else float(x <= y)
        case "and":
            return NAN if unknown else float(bool(x) and bool(y))
        case "or":
            return NAN if unknown else float(bool(x) or bool(y))
        case "not":
            return NAN if math.isnan(x) else float(not x)
        case "where":
            return NAN if math.isnan(x) else (y if x else z)
        case "hold":
            part.held = NAN if math.isnan(y) else (x if y else part.held)
            return part.held
        case "deadband":
            return NAN if math.isnan(x) else math.copysign(max(abs(x) - part.number, 0.0), x)
    return None


def _since_known(history: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the history from its first known value on."""
    for place, (_, value) in enumerate(history):
        if not math.isnan(value):
            return history[place:]
    return []


def _filtered(history: list[tuple[float, float]], frequency: float) -> float:
    """Return a Butterworth filter of second order, by the matrix exponential, since a NaN."""
    last_unknown = max((n for n, (_, x) in enumerate(history) if math.isnan(x)), default=-1)
    known = history[last_unknown + 1 :]
    if not known:
        return NAN
    omega = 2 * math.pi * frequency
    matrix = np.array([[0.0, 1.0], [-(omega**2), -math.sqrt(2) * omega]])
    state = np.array([known[0][1], 0.0])
    for (before_s, _), (after_s, value) in itertools.pairwise(known):
        aim = np.array([value, 0.0])
        state = aim + expm(matrix * (after_s - before_s)) @ (state - aim)
    return float(state[0])
