"""Lists the operations of expressions, and computes those of fixed values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum, unique


@unique
class Op(IntEnum):
    """The operations; :mod:`rigd.computed.derived.kernel` computes them in the cycle.

    Those from DERIVATIVE on take a step at a new value only; the others compute in every cycle.
    CONSTANT and PARAMETER are set from outside: once, and by each trial.
    """

    CONSTANT = 0
    INPUT = 1
    ADD = 2
    SUBTRACT = 3
    MULTIPLY = 4
    DIVIDE = 5
    NEGATE = 6
    ABS = 7
    SQRT = 8
    SIN = 9
    COS = 10
    TAN = 11
    ATAN2 = 12
    MIN = 13
    MAX = 14
    LESS = 15
    NOT_ABOVE = 16
    AND = 17
    OR = 18
    NOT = 19
    WHERE = 20
    HOLD = 21
    DEADBAND = 22
    LOOKUP = 23
    DERIVATIVE = 24
    LOWPASS = 25
    INTEGRAL = 26
    MEAN = 27
    RMS = 28
    HIGHEST = 29
    LOWEST = 30
    RATE_LIMIT = 31
    DELAY = 32
    EDGES = 33
    PARAMETER = 34


def compute(op: Op, values: Sequence[float], parameters: Sequence[float]) -> float | None:
    """Return the result of an operation on fixed values in SI, NaN if there is none.

    None: the operation needs values over time. NaN goes through every operation.
    """
    x, y, z = (*values, math.nan, math.nan)[:3]
    if any(map(math.isnan, values)):
        return math.nan if op < Op.DERIVATIVE and op is not Op.HOLD else None
    match op:
        case Op.ADD:
            return x + y
        case Op.SUBTRACT:
            return x - y
        case Op.MULTIPLY | Op.AND:
            return x * y
        case Op.DIVIDE:
            return x / y if y else math.nan
        case Op.NEGATE:
            return -x
        case Op.ABS:
            return abs(x)
        case Op.SQRT:
            return math.sqrt(x) if x >= 0 else math.nan
        case Op.SIN | Op.COS | Op.TAN:
            return {Op.SIN: math.sin, Op.COS: math.cos, Op.TAN: math.tan}[op](x)
        case Op.ATAN2:
            return math.atan2(x, y)
        case Op.MIN:
            return min(x, y)
        case Op.MAX | Op.OR:
            return max(x, y)
        case Op.LESS:
            return float(x < y)
        case Op.NOT_ABOVE:
            return float(x <= y)
        case Op.NOT:
            return 1.0 - x
        case Op.WHERE:
            return y if x else z
        case Op.DEADBAND:
            return math.copysign(max(abs(x) - parameters[0], 0.0), x)
        case Op.LOOKUP:
            return _interpolated(x, parameters)
    return None


def _interpolated(x: float, table: Sequence[float]) -> float:
    """Return the value at ``x`` of a table: its points, then its values; NaN outside of it."""
    count = len(table) // 2
    for low in range(count - 1):
        x0, x1 = table[low : low + 2]
        if x0 <= x <= x1:
            y0, y1 = table[count + low : count + low + 2]
            return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    return math.nan
