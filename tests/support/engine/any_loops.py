"""Random rigs of derived channels and controllers, what they read, and programs to play on them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from hypothesis import strategies as st
from support.engine.formula_draws import formulas

from rigd.model.severity import STOPS, Severity
from rigd.model.units import quotient
from rigd.procedure.profiles.profiles import ConstantProfile, Profile, Ramp, Sine
from rigd.procedure.program import CycleProgram, Hold, Segment

PERIOD_NS: Final = 1_000_000
RIG: Final = """\
rig: any-1
title: Draws its limits, channels and controllers
cycle: 1 kHz
plant: {model: lugre, floor: pvc}
devices:
  wheel_encoder: {driver: sim-lugre-encoder, options: {axis: wheel}}
  carriage: {driver: sim-lugre-encoder, options: {axis: carriage}}
  wheel_servo: {driver: sim-lugre-amplifier, limits: {current: %(wheel_servo.current)s}}
  longitudinal_belt:
    driver: sim-lugre-belt
    options: {axis: longitudinal}
    limits: {speed: %(longitudinal_belt.speed)s, engaged: %(longitudinal_belt.engaged)s}
  lateral_belt:
    driver: sim-lugre-belt
    options: {axis: lateral}
    limits: {speed: %(lateral_belt.speed)s, engaged: %(lateral_belt.engaged)s}
interlocks: []
derived:
%(derived)scontrollers:
%(controllers)s"""
OUTPUTS: Final = {
    "wheel_servo.current": "A", "longitudinal_belt.speed": "m/s", "lateral_belt.speed": "m/s",
    "longitudinal_belt.engaged": "1", "lateral_belt.engaged": "1",
}  # fmt: skip
SENSORS: Final = {"wheel_encoder.angle": "rad", "carriage.position": "m"}
WILD: Final = (math.nan, math.inf, -math.inf, -3.0, 0.0, 0.25, 1e-3, 7.0, 1e12, -1e300, 1e308)


@dataclass(frozen=True)
class Bounds:
    """Limits of one setpoint as they were drawn."""

    low: float
    high: float
    rate: float
    rest: float = 0.0

    def text(self, unit: str, *, rests: bool = True) -> str:
        """Return the limits as a rig file has them; those of a controller name no rest."""
        values = {"low": self.low, "high": self.high} | ({"rest": self.rest} if rests else {})
        keys = [f"{key}: {value!r} {unit}" for key, value in values.items()]
        return f"{{{', '.join(keys)}, rate: {self.rate!r} {quotient(unit, 's')}}}"

    def to_rest(self, now: float) -> float:
        """Return where a stop leads it in one cycle."""
        most = self.rate * 1e-3
        return now + min(max(self.rest - now, -most), most)


@dataclass(frozen=True)
class Loop:
    """A controller as it was drawn."""

    name: str
    inputs: tuple[str, ...]  #: measured, feed-forward, schedule
    scheduled: bool
    output: str
    span: tuple[float, float]  #: of the output
    bounds: Bounds
    stale_ns: int
    frozen_ns: int
    text: str

    @property
    def setpoint(self) -> str:
        return f"{self.name}.{self.inputs[0].partition('.')[2]}"

    @property
    def goal(self) -> str:
        """Its setpoint as a channel of the recording."""
        return f"{self.setpoint}_setpoint"


@dataclass(frozen=True)
class Case:
    """A rig, what its sensors read, and what is played on it."""

    text: str
    limits: Mapping[str, Bounds]
    uses: Mapping[str, frozenset[str]]  #: channels to the sensors they are computed from
    loops: tuple[Loop, ...]
    read: Mapping[str, Sequence[str | float]]  #: by sensor, what becomes of each reading
    programs: tuple[tuple[CycleProgram, str], ...]
    asked: tuple[int, Severity] | None


@st.composite
def bounds(draw: st.DrawFn, size: float, rest: bool = True) -> Bounds:
    low, high = sorted(draw(st.lists(st.integers(-20, 20), min_size=2, max_size=2, unique=True)))
    rate = draw(st.sampled_from([0.5, 3.0, 20.0, 500.0, 1e5]))
    unit = size / 20
    low, high = min(low, 0) if rest else low, max(high, 0) if rest else high
    at = draw(st.integers(low, high)) if rest else 0
    return Bounds(unit * low, unit * high, rate, unit * at)


@st.composite
def channels(draw: st.DrawFn) -> tuple[dict[str, str], dict[str, frozenset[str]]]:
    """Draw formulas by channel, each of sensors or of channels before it."""
    texts = {"ra.x": "wheel_encoder.angle / 1 rad", "rb.x": "carriage.position / 1 m"}
    uses = {"ra.x": frozenset({"wheel_encoder"}), "rb.x": frozenset({"carriage"})}
    for name in ("d0.x", "d1.x"):
        formula = draw(formulas.filter(lambda part: "dev_" in part.text())).text()
        used = frozenset[str]()
        for place in ("dev_a.x", "dev_b.x"):
            if place in formula:
                chosen = draw(st.sampled_from([*texts]))
                formula = formula.replace(place, chosen)
                used |= uses[chosen]
        texts[name], uses[name] = formula, used
    return texts, uses


@st.composite
def loop(
    draw: st.DrawFn, name: str, free: Mapping[str, tuple[str, Bounds]], known: Sequence[str],
    derived: dict[str, str], uses: dict[str, frozenset[str]],
) -> Loop:  # fmt: skip
    """Draw a controller; feed-forward and schedule become derived channels of their own."""
    output = draw(st.sampled_from([*free]))
    unit, limit = free[output]
    measured = draw(st.sampled_from([*known, *SENSORS]))
    own = SENSORS.get(measured, "1")
    size = 0.1 if measured in SENSORS else 4.0
    goal = draw(bounds(size, rest=False))
    keys = [f"measured: {measured}", f"output: {output}", f"limits: {goal.text(own, rests=False)}"]
    low, high = limit.low, limit.high
    if draw(st.booleans()):
        low, high = low + 0.25 * (high - low), high - 0.125 * (high - low)
        keys.append(f"output_limits: [{low!r} {unit}, {high!r} {unit}]")
    sign = draw(st.sampled_from([1.0, -1.0]))
    inputs, scheduled = [measured], False
    if draw(st.integers(0, 5)) == 0:
        jump = sign * draw(st.sampled_from([0.1, 0.5])) * (high - low)
        keys += [f"relay: {jump!r} {unit}", f"hysteresis: 0.01 {own}"]
    else:
        gains = {
            "kp": draw(st.sampled_from([0.0, 0.1, 5.0, 1e3, 1e9])),
            "ki": draw(st.sampled_from([0.0, 1.0, 300.0, 1e9])),
            "kd": draw(st.sampled_from([0.0, 0.01, 10.0])),
        }
        gains["kp"] = gains["kp"] if any(gains.values()) else 1.0
        per = {"kp": quotient(unit, own), "ki": quotient(unit, f"{own} s"),
               "kd": quotient(f"{unit} s", own)}  # fmt: skip
        keys += [f"{key}: {sign * gain!r} {per[key]}" for key, gain in gains.items() if gain]
        keys += ["filter: 40 Hz"] if gains["kd"] else []
        keys.append(f"setpoint_weight: {draw(st.sampled_from([0.0, 0.5, 1.0]))}")
        for key, wide in (
            ("feed_forward", "{} * 1" + f" {unit}" * (unit != "1")),
            ("schedule", "{} + 2"),
        ):
            if draw(st.booleans()):
                source = draw(st.sampled_from(known))
                channel = f"{name}_{key}.y"
                derived[channel], uses[channel] = wide.format(source), uses[source]
                keys.append(f"{key}: {channel}")
                inputs.append(channel)
                scheduled = key == "schedule"
    stale, frozen, stuck = (
        draw(st.sampled_from(times))
        for times in ([20, 4, 2], [1000, 1000, 10, 3], [2000, 2000, 30, 5])
    )
    keys += [f"stale_after: {stale} ms", f"frozen_after: {frozen} ms", f"stuck_after: {stuck} ms"]
    return Loop(
        name, tuple(inputs), scheduled, output, (low, high), goal, stale * PERIOD_NS,
        frozen * PERIOD_NS, f"  {name}: {{{', '.join(keys)}}}\n",
    )  # fmt: skip


numbers = st.sampled_from([-1e9, -0.7, -0.02, 0.0, 0.01, 0.3, 1.2, 50.0])
profiles: st.SearchStrategy[Profile] = st.one_of(
    st.builds(ConstantProfile, numbers),
    st.builds(Ramp, st.none() | numbers, numbers, st.sampled_from([0.001, 0.02])),
    st.builds(Sine, numbers, st.sampled_from([7.0, 480.0])),
)


@st.composite
def programs(draw: st.DrawFn, settable: Sequence[str], number: int) -> CycleProgram:
    chosen = st.lists(st.sampled_from(settable), min_size=1, max_size=3, unique=True)
    segments = []
    for place in range(draw(st.integers(2, 5))):
        held = None
        if draw(st.integers(0, 3)) == 0:
            held = Hold({name: draw(numbers) for name in draw(chosen)}, 0.03)
        segments.append(
            Segment(
                f"p{number}s{place}", {name: draw(profiles) for name in draw(chosen)},
                duration_s=1e-3 * draw(st.sampled_from([40, 12, 1, 90])), hold=held,
            )
        )  # fmt: skip
    return CycleProgram(tuple(segments))


#: What a sensor reads for some cycles: of the plant, the same, nothing, leaps, or a number.
kinds = st.sampled_from(["plant", "still", "lost", "jump"]) | st.sampled_from(WILD)
episodes = st.lists(
    st.tuples(st.sampled_from([1, 5, 25]), kinds, st.sampled_from([60, 20, 1])), max_size=6
)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    derived, uses = draw(channels())
    known = [*derived]
    limits = {
        name: Bounds(0.0, 1.0, 9.0, 1.0) if unit == "1" else draw(bounds(0.5))
        for name, unit in OUTPUTS.items()
    }
    free = {name: (unit, limits[name]) for name, unit in OUTPUTS.items()}
    loops: list[Loop] = []
    for number in range(draw(st.integers(1, 4))):
        made = draw(loop(f"c{number}", free, known, derived, uses))
        loops.append(made)
        del free[made.output]
        free[made.name] = SENSORS.get(made.inputs[0], "1"), made.bounds
    uses |= {name: frozenset({name.partition(".")[0]}) for name in SENSORS}
    settable = [*limits, *(3 * [item.setpoint for item in loops])]
    played = [
        (draw(programs(settable, number)), draw(st.sampled_from(["next", "rest", "wait"])))
        for number in range(draw(st.integers(1, 3)))
    ]
    text = RIG % {
        **{name: limits[name].text(unit) for name, unit in OUTPUTS.items()},
        "derived": "".join(f'  {name}: {{is: "{is_}"}}\n' for name, is_ in derived.items()),
        "controllers": "".join(item.text for item in loops),
    }
    read = {
        name.partition(".")[0]: [
            item
            for count, kind, well in draw(episodes)
            for item in (*(well * ["plant"]), *(count * [kind]))
        ]
        for name in SENSORS
    }
    asked = st.none() | st.none() | st.tuples(st.integers(1, 300), st.sampled_from(STOPS))
    return Case(text, limits, uses, tuple(loops), read, tuple(played), draw(asked))
