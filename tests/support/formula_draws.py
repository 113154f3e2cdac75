"""Formulas of the channels ``dev_a.x`` and ``dev_b.x``, drawn at random."""

from __future__ import annotations

from hypothesis import strategies as st
from support.formula_reference import Part

from rigd.derived.formula import MAX_LENGTH

numbers = st.sampled_from([-3.0, -0.5, 0.25, 1.0, 2.0]).map(lambda x: Part("number", number=x))
leaves = st.one_of(st.builds(Part, st.sampled_from(["a", "b"])), numbers)


def joined(kinds: list[str], *parts: st.SearchStrategy[Part]) -> st.SearchStrategy[Part]:
    return st.builds(lambda kind, *inside: Part(kind, inside), st.sampled_from(kinds), *parts)


#: Parts without rounding: both forms agree on which of two is larger, and on what is zero.
exact = st.one_of(
    leaves, joined(["+", "-", "*", "min", "max"], leaves, leaves), joined(["abs"], leaves),
    leaves.map(lambda part: Part("delay", (part,), 0.004)),
    leaves.map(lambda part: Part("highest", (part,), 0.004)),
)  # fmt: skip
compared = joined(["<", "<="], exact, exact)
conditions = st.one_of(
    compared, joined(["and", "or"], compared, compared), joined(["not"], compared)
)


def wider(parts: st.SearchStrategy[Part]) -> st.SearchStrategy[Part]:
    fixed = st.sampled_from(
        [("lowpass", 20.0), ("lowpass", 250.0), ("ratelimit", 40.0), ("deadband", 0.5)]
        + [(kind, window) for kind in ("mean", "rms", "highest", "lowest", "delay")
           for window in (0.001, 0.004, 0.0075)]
    )  # fmt: skip
    return st.one_of(
        joined(["+", "-", "*", "min", "max"], parts, parts),
        joined(["/"], parts, exact.filter(lambda part: "dev_" in part.text())),
        joined(["negative", "abs", "derivative", "integral"], parts),
        joined(["sqrt", "sin", "cos", "tan", "lookup"], exact),
        joined(["atan2"], leaves, leaves),  # elsewhere a zero may differ in its sign
        st.builds(lambda x, power: Part("**", (x,), power), parts, st.sampled_from([2.0, 3.0])),
        st.builds(lambda f, x: Part(f[0], (x,), f[1]), fixed, parts),
        joined(["where"], conditions, parts, parts),
        joined(["hold"], parts, conditions),
        joined(["edges"], conditions),
    )


formulas = st.recursive(leaves, wider, max_leaves=6).filter(
    lambda part: len(part.text()) <= MAX_LENGTH
)
