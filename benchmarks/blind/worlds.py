"""What goes wrong at a LuGre rig, in two sizes, and the words that count as its right name.

The words were written before any result was seen: those that a person at the rig would accept. Some
were made stricter after the first sixty results, as "carriage" stood in "a force on the carriage"
too, and none was made looser. If
the data cannot tell two causes apart, either is right: a constant torque of the motor and a zero of
the current, forces on the carriage that do not change, a delay and a slow filter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from blind.kind import Kind
from blind.rig import FLOORS, G, Rig, Trial, draw, draw_lateral

Apply = Callable[[Rig, float, np.random.Generator], None]

#: What one sentence about a cause may say instead of another.
CARRIAGE_FORCE: Final = r"guide|rolling|slope|drag|force on the carriage|clutch|belt"
DRIVE: Final = r"torque|drive|efficien|gear ratio|gain of the current|monitor"
ALONG: Final = r"position|along|place|each [\d.]+ m?m\b|of the floor"
TRIAL: Final = r"trial|record|order|wear|rises|falls|differs|in time"
WHEEL_TURN: Final = r"wheel angle|eccentric|runout|out of round|turn|roller|revolution"
LATE: Final = r"delay|late|filter|lag|slow|clock"


def kinds() -> dict[str, Kind[Rig]]:
    """Return every kind by its name."""
    found = [*_constants(), *_mechanics(), *_friction(), *_electrics(), *_sensors(), *_procedure()]
    found += [*_laws(), *_encoders()]  # behind the others: their places choose their seeds
    assert len({kind.name for kind in found}) == len(found)
    return {kind.name: kind for kind in found}


def world(name: str, size: int, seed: int) -> Rig:
    """Return the right rig of that seed with the kind in it."""
    known = kinds()
    number = list(known).index(name)
    rig = draw(1000 + 10 * number + seed)
    known[name].apply(rig, known[name].sizes[size], np.random.default_rng([5, number, size, seed]))
    return rig


def lateral_kinds() -> dict[str, Kind[Rig]]:
    """Return every kind of a lateral sweep by its name: of all that can go wrong, and its own."""
    shared = [
        "torque_constant low",
        "guide_friction low",
        "guide_friction high",
        "mass low: a weight forgotten",
        "wheel_radius high",
        "rolling_resistance low",
        "eccentric wheel",
        "slope",
        "cable drag",
        "guide varies along",
        "floor step at 0.6 m",
        "friction rises",
        "one trial other",
        "monitor gain low",
        "accelerometer gain low",
        "carriage late",
        "measuring wheel eccentric",
        "current zero drifts",
    ]
    everything = kinds()
    return {kind.name: kind for kind in (*(everything[name] for name in shared), *_lateral())}


def lateral_world(name: str, size: int, seed: int) -> Rig:
    """Return the right lateral sweep of that seed with the kind in it."""
    known = lateral_kinds()
    number = list(known).index(name)
    rig = draw_lateral(1000 + 10 * number + seed)
    known[name].apply(rig, known[name].sizes[size], np.random.default_rng([6, number, size, seed]))
    return rig


def _turn(rig: Rig) -> None:
    """Give it three trials that brake by the motor, as without them it would never show."""
    if not any(trial.shape == "change" for trial in rig.trials):
        for n, (first, second) in enumerate(((0.6, -0.9), (0.9, -0.6), (1.2, -0.9))):
            rig.trials.insert(2 * n, Trial(first, "change", second, 0.45, 1.0))


def _state(name: str) -> Apply:
    def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
        value, _u = rig.stated[name]
        share = _u / value if value else 0
        rig.stated[name] = (value * size, value * size * share)

    return apply


def _true(name: str) -> Apply:
    def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.true[name] = size

    return apply


def _turned(apply: Apply) -> Apply:
    def both(rig: Rig, size: float, random: np.random.Generator) -> None:
        _turn(rig)
        apply(rig, size, random)

    return both


def _sensor(group: str, channel: str) -> Apply:
    def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
        getattr(rig.sensors, group)[channel] = size

    return apply


def _set(attribute: str) -> Apply:
    def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
        setattr(rig.sensors, attribute, size)

    return apply


def _constants() -> list[Kind[Rig]]:
    on_motor = r"no.load|bearing|friction of the motor|zero of the current|current.*zero|offset"
    radius = (
        r"radius|diameter|measuring wheel|counts|"
        r"wheel encoder.*(scale|gain|count)|carriage.*(scale|gain)"
    )
    mass = rf"mass|weight|load|{DRIVE}"
    rows = [
        ("torque_constant high", "torque_constant", (1.05, 1.15), DRIVE),
        ("torque_constant low", "torque_constant", (0.95, 0.87), DRIVE),
        ("gear_efficiency high", "gear_efficiency", (1.13, 1.2), DRIVE),
        ("gear_efficiency low", "gear_efficiency", (0.87, 0.75), DRIVE),
        ("no_load_torque high", "no_load_torque", (1.6, 2.5), on_motor),
        ("no_load_torque low", "no_load_torque", (0.5, 0.1), on_motor),
        ("no_load_viscous low", "no_load_viscous", (0.3, 0.05), r"viscous|no.load|drag|back.emf"),
        ("no_load_viscous high", "no_load_viscous", (2.5, 5.0), r"viscous|no.load|drag|back.emf"),
        ("motor_inertia low", "motor_inertia", (0.6, 0.2), "inertia"),
        ("motor_inertia high", "motor_inertia", (1.5, 3.0), "inertia"),
        ("wheel_inertia low", "wheel_inertia", (0.75, 0.3), "inertia"),
        ("wheel_inertia high", "wheel_inertia", (1.3, 2.5), "inertia"),
        ("wheel_radius low", "wheel_radius", (0.988, 0.96), radius),
        ("wheel_radius high", "wheel_radius", (1.012, 1.04), radius),
        ("guide_friction low", "guide_friction", (0.7, 0.2), CARRIAGE_FORCE),
        ("guide_friction high", "guide_friction", (1.4, 2.5), CARRIAGE_FORCE),
        ("rolling_resistance low", "rolling_resistance", (0.5, 0.1), CARRIAGE_FORCE),
        ("rolling_resistance high", "rolling_resistance", (1.6, 3.0), CARRIAGE_FORCE),
        ("mass low: a weight forgotten", "mass", (0.97, 0.85), mass),
        ("mass high", "mass", (1.03, 1.15), mass),
        (
            "roller_transitions",
            "roller_transitions",
            (0.9, 0.5),
            r"roller|transition|vibrat|turn|wheel angle",
        ),
    ]
    found = [Kind(name, "constants", sizes, words, _state(of)) for name, of, sizes, words in rows]

    def gear(rig: Rig, size: float, _: np.random.Generator) -> None:
        value, u = rig.stated["gear_ratio"]
        rig.stated["gear_ratio"] = (value * size, u)
        rig.sensors.scales["angle"] = 1 / size

    found.append(
        Kind("gear_ratio", "constants", (0.97, 1.15), rf"radius|wheel encoder|counts|{DRIVE}", gear)
    )
    return found


def _mechanics() -> list[Kind[Rig]]:
    loose = r"backlash|play|slack|coupling|shaft|wind|twist|elastic|complian|gear"

    def eccentric(which: str) -> Apply:
        def apply(rig: Rig, size: float, random: np.random.Generator) -> None:
            rig.true[which] = size / rig.true["radius"]
            rig.true["eccentric_phase"] = random.uniform(0, 2 * np.pi)

        return apply

    def backlash(rig: Rig, size: float, _: np.random.Generator) -> None:
        _turn(rig)
        rig.true["stiffness"], rig.true["backlash"] = 400.0, np.deg2rad(size)
        rig.substeps = 10

    def soft(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.true["stiffness"] = size
        rig.substeps = 10

    def lift(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.true["load"] -= size * rig.true["mass"] * G

    bodies = r"load|weight|hop|bounc|roller|vibrat|wheel angle|turn|speed"
    return [
        Kind("backlash", "mechanics", (0.3, 1.5), loose, backlash),
        Kind("soft coupling", "mechanics", (60.0, 12.0), loose, soft),
        Kind("eccentric wheel", "mechanics", (1e-4, 4e-4), WHEEL_TURN, eccentric("eccentric")),
        Kind("oval wheel", "mechanics", (1e-4, 4e-4), WHEEL_TURN, eccentric("second_harmonic")),
        Kind("slope", "mechanics", (0.08, 0.25), r"slope|tilt|level|inclin", _true("slope")),
        Kind("slope down", "mechanics", (-0.08, -0.25), r"slope|tilt|level|inclin", _true("slope")),
        Kind("cable drag", "mechanics", (0.25, 1.0), r"drag|cable|viscous|guide", _true("drag")),
        Kind("cable spring", "mechanics", (0.3, 1.2), rf"cable|spring|{ALONG}",
            _true("cable_spring")),
        Kind("clutch drags", "mechanics", (0.15, 0.8), CARRIAGE_FORCE, _true("clutch_drag")),
        Kind("air drag", "mechanics", (0.1, 0.5), r"drag|speed|air|cable|viscous", _true("air")),
        Kind("wheel hops", "mechanics", (0.05, 0.2), bodies, _true("hop")),
        Kind("flat roller", "mechanics", (2.0, 8.0), rf"flat|{WHEEL_TURN}", _true("flat_force")),
        Kind("guide varies along", "mechanics", (0.4, 1.2), rf"guide|{ALONG}", _true("guide_wave")),
        Kind("guide sticks", "mechanics", (0.6, 2.5), r"guide|stick|stiction|drag|low speed",
            _true("guide_stiction")),
        Kind("load varies along", "mechanics", (0.6, 3.0), rf"load|guide|lift|{ALONG}",
            _true("load_slope")),
        Kind("load shifts with force", "mechanics", (0.1, 0.4),
            r"load|force|tilt|slip|law|friction", _true("tilt_load")),
        Kind("guide bears weight", "mechanics", (0.03, 0.1), r"load|lift|weight|mass", lift,
            documented=True),
    ]  # fmt: skip


def _friction() -> list[Kind[Rig]]:
    def trend(sign: float) -> Apply:
        def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
            for n, trial in enumerate(rig.trials):
                trial.level = 1 + sign * size * n

        return apply

    def single(rig: Rig, size: float, random: np.random.Generator) -> None:
        rig.trials[int(random.integers(1, len(rig.trials) - 1))].level = 1 - size

    def scatter(rig: Rig, size: float, random: np.random.Generator) -> None:
        for trial in rig.trials:
            trial.level = 1 + size * random.normal()

    def later(rig: Rig, size: float, _: np.random.Generator) -> None:
        for trial in rig.trials[len(rig.trials) // 2 :]:
            trial.level = 1 - size

    def other_floor(rig: Rig, size: float, _: np.random.Generator) -> None:
        other = FLOORS["pvc" if rig.floor != "pvc" else "stone"]
        mixed = {
            name: rig.true[name] * (1 - size) + size * other[name]
            for name in ("mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2", "rolling")
        }
        for trial in rig.trials[len(rig.trials) // 2 :]:
            trial.constants = dict(mixed)

    def waits(rig: Rig, size: float, random: np.random.Generator) -> None:
        rig.true["age_size"] = size
        for trial in rig.trials:
            trial.wait = float(random.choice([1.0, 10.0, 100.0, 1000.0]))

    law = r"law|stribeck|exponent|slip|friction at"
    return [
        Kind("floor step at 0.6 m", "friction", (0.04, 0.15), ALONG, _true("step_size")),
        Kind("dirty patch", "friction", (-0.06, -0.25), ALONG, _true("patch_size")),
        Kind("friction waves along", "friction", (0.03, 0.12), ALONG, _true("wave_size")),
        Kind("friction rises", "friction", (0.006, 0.03), TRIAL, trend(1)),
        Kind("friction falls", "friction", (0.006, 0.03), TRIAL, trend(-1)),
        Kind("one trial other", "friction", (0.06, 0.25), TRIAL, single),
        Kind("trials scatter", "friction", (0.02, 0.06), TRIAL, scatter),
        Kind("cleaned half way", "friction", (0.04, 0.2), TRIAL, later),
        Kind("other floor half way", "friction", (0.1, 1.0), rf"floor|{TRIAL}", other_floor),
        Kind("ageing in rest", "friction", (0.01, 0.04), rf"dwell|age|ageing|rest|static|{law}",
            waits),
        Kind("warms by slip", "friction", (0.15, 0.6),
            r"warm|heat|temperature|time|fade|slip|trial", _true("heat_size")),
        Kind("backward less", "friction", (-0.08, -0.3),
            r"direction|backward|sign|revers|side|brak", _turned(_true("backward"))),
        Kind("gaussian law", "friction", (1.0, 2.0), law, _true("exponent")),
        Kind("rolling relaxation", "friction", (0.3, 2.0), rf"roll|relax|wheel speed|{law}",
            _true("relaxation")),
        Kind("uneven rollers", "friction", (0.03, 0.12), WHEEL_TURN, _true("turn_size")),
        Kind("runs in at the start", "friction", (0.06, 0.3), rf"start|time|run|{ALONG}",
            _true("run_in")),
    ]  # fmt: skip


def _electrics() -> list[Kind[Rig]]:
    ripple = r"ripple|cogging|motor turn|turn|gear|teeth|wheel angle|torque"
    current = r"current|monitor"

    def gain(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.sensors.current_gain = size

    def drift(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.sensors.zeros = (size * np.linspace(0, 1, len(rig.trials))).tolist()

    def tone(channel: str) -> Apply:
        def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
            rig.sensors.tones[channel] = (size, 50.0)

        return apply

    def brake(rig: Rig, size: float, _: np.random.Generator) -> None:
        _turn(rig)
        rig.true["back_drive"] = 1.0
        if size:
            for trial in rig.trials:
                trial.second *= 0.7 if trial.shape == "change" else 1.0

    hum = r"mains|hum|50 hz|49|51"
    return [
        Kind("torque ripple", "electrics", (0.05, 0.2), ripple, _true("torque_ripple")),
        Kind("cogging", "electrics", (8e-4, 4e-3), ripple, _true("cogging")),
        Kind("monitor gain high", "electrics", (1.05, 1.15), rf"{current}|{DRIVE}", gain),
        Kind("monitor gain low", "electrics", (0.95, 0.85), rf"{current}|{DRIVE}", gain),
        Kind("monitor bends", "electrics", (0.03, 0.12), rf"{current}|saturat|{DRIVE}",
            _set("squared")),
        Kind("monitor clips", "electrics", (1.0, 0.7), rf"{current}|clip|range|saturat|end of",
            _sensor("clips", "current")),
        Kind("current zero", "electrics", (0.02, 0.06), rf"{current}|no.load",
            _set("current_zero")),
        Kind("current zero negative", "electrics", (-0.02, -0.06), rf"{current}|no.load",
            _set("current_zero")),
        Kind("current zero drifts", "electrics", (0.015, 0.06), rf"{current}|no.load|drift|trial",
            drift),
        Kind("mains on the current", "electrics", (0.02, 0.08), rf"{hum}|{current}",
            tone("current")),
        Kind("mains on the accelerometer", "electrics", (0.1, 0.5),
            r"(mains|hum|50 hz)[^.]*acceler|acceler[^.]*(mains|hum|50 hz)", tone("acceleration")),
        Kind("motor fades", "electrics", (0.03, 0.12), r"fade|motor|heat|warm|torque|drive|time",
            _true("fade")),
        Kind("gear drags when driven back", "electrics", (0.0, 1.0),
            rf"brak|direction|revers|{DRIVE}", brake),
        Kind("monitor late", "electrics", (0.003, 0.012), rf"{LATE}|{current}", _sensor("delays",
            "current")),
        Kind("monitor filtered", "electrics", (30.0, 6.0), rf"{LATE}|{current}", _sensor("filters",
            "current")),
    ]  # fmt: skip


def _sensors() -> list[Kind[Rig]]:
    accelerometer = r"accelerometer"
    carriage = r"carriage encoder|carriage position|position of the carriage|measuring wheel"
    wheel = r"wheel encoder|encoder of the wheel|wheel angle"

    def late(*channels: str) -> Apply:
        def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
            for channel in channels:
                rig.sensors.delays[channel] = size

        return apply

    def spikes(channel: str) -> Apply:
        def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
            rig.sensors.spikes[channel] = (0.001, size)

        return apply

    def rings(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.sensors.resonance = (size, 60.0)

    def wobble(channel: str, period: float) -> Apply:
        def apply(rig: Rig, size: float, random: np.random.Generator) -> None:
            rig.sensors.wobble[channel] = (size, period, random.uniform(0, 6))

        return apply

    def jump(channel: str) -> Apply:
        def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
            rig.sensors.steps_at[channel] = (0.6, size)

        return apply

    def gains(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.sensors.gains = (1 - size * np.linspace(0, 1, len(rig.trials))).tolist()

    def gain(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.sensors.acceleration_gain = size

    def rolled(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.sensors.scales["position"] = size
        value, u = rig.stated["wheel_radius"]
        rig.stated["wheel_radius"] = (value * size, u)

    scaled = r"radius|diameter|scale|gain|measuring|counts|carriage|position"
    return [
        Kind("accelerometer late", "sensors", (0.003, 0.012), accelerometer, late("acceleration")),
        Kind("carriage late", "sensors", (0.005, 0.015), carriage, late("position")),
        Kind("wheel encoder late", "sensors", (0.005, 0.015), wheel, late("angle")),
        Kind("both encoders late", "sensors", (0.005, 0.015), rf"{LATE}|encoders", late("angle",
            "position")),
        Kind("all but the current late", "sensors", (0.005, 0.015), rf"{LATE}|current",
            late("angle", "position", "acceleration")),
        Kind("wheel encoder jitters", "sensors", (5e-4, 3e-3), rf"jitter|clock|time|{wheel}",
            _sensor("jitter", "angle")),
        Kind("wheel misses counts", "sensors", (0.01, 0.05), rf"count|slip|{wheel}",
            _sensor("missed", "angle")),
        Kind("carriage misses counts", "sensors", (0.003, 0.02), rf"count|{carriage}",
            _sensor("missed", "position")),
        Kind("carriage counts backward", "sensors", (-1.0,),
            rf"sign|direction|backward|other way|opposite|{carriage}", _sensor("scales",
            "position")),
        Kind("accelerometer turned", "sensors", (-1.0,), accelerometer, gain),
        Kind("current with the wrong sign", "sensors", (-1.0,), r"sign|current|monitor|inverted",
            _set("current_gain")),
        Kind("accelerometer gain low", "sensors", (0.93, 0.75), accelerometer, gain),
        Kind("accelerometer gain high", "sensors", (1.07, 1.3), accelerometer, gain),
        Kind("accelerometer filtered", "sensors", (20.0, 4.0), accelerometer, _sensor("filters",
            "acceleration")),
        Kind("carriage filtered", "sensors", (25.0, 6.0), carriage, _sensor("filters", "position")),
        Kind("wheel filtered", "sensors", (25.0, 6.0), wheel, _sensor("filters", "angle")),
        Kind("carriage coarse", "sensors", (2e-4, 1e-3), rf"coarse|round|resol|count|{carriage}",
            _set("guide")),
        Kind("accelerometer coarse", "sensors", (0.2, 0.6), accelerometer,
            _set("acceleration_step")),
        Kind("accelerometer drifts", "sensors", (0.02, 0.1), rf"slope|{accelerometer}",
            _sensor("drifts", "acceleration")),
        Kind("measuring wheel slips", "sensors", (0.003, 0.012), rf"slip|{scaled}", _set("slip")),
        Kind("measuring wheel scale", "sensors", (1.01, 1.04), scaled, _sensor("scales",
            "position")),
        Kind("measuring wheel eccentric", "sensors", (1.5e-4, 6e-4),
            rf"eccentric|runout|{ALONG}|{carriage}", wobble("position", 0.12566)),
        Kind("wheel encoder eccentric", "sensors", (0.002, 0.01), rf"{WHEEL_TURN}|{wheel}",
            wobble("angle", 2 * np.pi)),
        Kind("accelerometer spikes", "sensors", (2.0, 10.0), rf"spike|jump|outlier|{accelerometer}",
            spikes("acceleration")),
        Kind("accelerometer mount rings", "sensors", (0.1, 0.6), accelerometer, rings),
        Kind("accelerometer feels the current", "sensors", (0.06, 0.3), accelerometer,
            _set("cross")),
        Kind("accelerometer zero jumps", "sensors", (0.05, 0.3), accelerometer,
            jump("acceleration")),
        Kind("accelerometer gain falls by trial", "sensors", (0.12, 0.4), rf"trial|{accelerometer}",
            gains),
        Kind("carriage jumps", "sensors", (8e-4, 6e-3), rf"jump|slip|{carriage}", jump("position")),
        Kind("rows missing", "sensors", (0.005, 0.05), r"row|missing|lost|gap|sample|bridged",
            _set("gone")),
        Kind("carriage rows repeat", "sensors", (0.01, 0.08), rf"repeat|row|late|stuck|{carriage}",
            _sensor("stuck", "position")),
        Kind("clock slow", "sensors", (0.993, 0.97), r"clock|time|rate", _set("clock"),
            documented=True),
        Kind("rolled along a wrong measuring wheel", "sensors", (1.007, 1.03), scaled, rolled,
            documented=True),
    ]  # fmt: skip


def _procedure() -> list[Kind[Rig]]:
    def added(rig: Rig, size: float, _: np.random.Generator) -> None:
        for trial in rig.trials[len(rig.trials) // 2 :]:
            trial.constants |= {
                "mass": rig.true["mass"] * (1 + size),
                "load": rig.true["load"] * (1 + size),
            }

    def touch(rig: Rig, size: float, random: np.random.Generator) -> None:
        trial = rig.trials[int(random.integers(len(rig.trials)))]
        trial.constants |= {"touch_force": size, "touch_at": 0.35, "touch_time": 0.2}

    def clutch(rig: Rig, _: float, random: np.random.Generator) -> None:
        rig.trials[int(random.integers(len(rig.trials)))].clutch = True

    def unrelaxed(rig: Rig, _: float, __: np.random.Generator) -> None:
        for trial in rig.trials:
            trial.relaxed = False

    def sloped(rig: Rig, size: float, _: np.random.Generator) -> None:
        for trial in rig.trials[len(rig.trials) // 2 :]:
            trial.constants |= {"slope": rig.true["slope"] + size}

    return [
        Kind("weight added half way", "procedure", (0.04, 0.2), r"mass|weight|load|trial|drive",
            added),
        Kind("operator touches", "procedure", (-1.5, -8.0), r"touch|force|trial|moment|jump|hand",
            touch),
        Kind("clutch left in", "procedure", (1.0,),
            r"clutch|held|left out|not move|does not move|stand|trial", clutch),
        Kind("not relaxed", "procedure", (1.0,), r"rest|relax|bristle|start|begin|deflect|preload",
            unrelaxed),
        Kind("table moved half way", "procedure", (0.08, 0.3), r"slope|tilt|level|trial|force",
            sloped),
    ]  # fmt: skip


def _laws() -> list[Kind[Rig]]:
    """Other laws of the Stribeck effect; V_s, mu_s and mu_c keep their meaning."""

    def lorentz(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.true["lorentz"], rig.true["exponent"] = 1.0, size

    def plateau(rig: Rig, size: float, _: np.random.Generator) -> None:
        rig.true["plateau"] = size * rig.true["v_s"]

    law = r"law|stribeck|exponent|friction that depends on the (speed|slip)"
    return [
        Kind("exponent low", "friction", (0.45, 0.35), law, _true("exponent")),
        Kind("exponent high", "friction", (0.55, 0.7), law, _true("exponent")),
        Kind("exponential law", "friction", (1.0,), law, _true("exponent")),
        Kind("steep law", "friction", (2.0, 3.0), law, _true("exponent")),
        Kind("lorentz law", "friction", (1.0, 2.0), law, lorentz),
        Kind("plateau law", "friction", (0.1, 1.0), law, plateau),
    ]


def _encoders() -> list[Kind[Rig]]:
    """Encoders with single readings that jump aside, all to one side."""

    def spikes(channel: str) -> Apply:
        def apply(rig: Rig, size: float, _: np.random.Generator) -> None:
            rig.sensors.spikes[channel] = (3e-4, size)
            rig.sensors.one_sided = True

        return apply

    carriage, wheel = r"carriage (encoder|position)", r"wheel encoder"
    return [
        Kind("carriage spikes", "sensors", (5e-4, 2e-3), carriage, spikes("position")),
        Kind("wheel encoder spikes", "sensors", (5e-3, 2e-2), wheel, spikes("angle")),
    ]


def _lateral() -> list[Kind[Rig]]:
    """What goes wrong with the lateral motion itself."""
    lengths = r"lever|height|half span|half distance|row|offset|length|guide"

    def sign(rig: Rig, _: float, __: np.random.Generator) -> None:
        rig.sensors.scales["lateral"] = -1.0

    def physical(apply: Apply) -> Apply:
        """Let a lifted row not rub: as Eq. 26 is printed, more friction would lock itself."""

        def both(rig: Rig, size: float, random: np.random.Generator) -> None:
            rig.true["lifted_rubs_not"] = 1.0
            apply(rig, size, random)

        return both

    def wear(rig: Rig, size: float, _: np.random.Generator) -> None:
        for n, trial in enumerate(rig.trials):
            trial.constants |= {"roller_dry": rig.true["roller_dry"] * (1 + size * n)}

    def stuck(rig: Rig, size: float, random: np.random.Generator) -> None:
        trial = rig.trials[int(random.integers(len(rig.trials)))]
        trial.constants |= {"roller_dry": rig.true["roller_dry"] * (1 + size)}

    rollers = r"roller|lateral|mu_r|side"
    return [
        Kind("guide_lever low", "lateral", (0.75, 0.5), lengths, _state("guide_lever")),
        Kind("guide_lever high", "lateral", (1.3, 1.8), lengths, _state("guide_lever")),
        Kind("guide_height", "lateral", (0.9, 0.7), lengths, _state("guide_height"),
            documented=True),
        Kind("guide_half_span", "lateral", (1.3, 2.0), lengths, _state("guide_half_span")),
        Kind("row_distance", "lateral", (0.8, 1.5), lengths, _state("row_distance")),
        Kind("mass_offset", "lateral", (0.7, 1.5), lengths, _state("mass_offset")),
        Kind("lateral speed turned", "lateral", (1.0,), r"sign|turned|direction|other side|way",
            sign),
        Kind("lateral speed scale", "lateral", (1.05, 1.3), rollers, _sensor("scales", "lateral")),
        Kind("lateral speed late", "lateral", (0.02, 0.1), rf"{LATE}|{rollers}", _sensor("delays",
            "lateral")),
        Kind("rollers rub more one way", "lateral", (0.1, 0.4),
            rf"direction|sign|{rollers}|{lengths}", physical(_true("roller_side")),
            documented=True),
        Kind("rollers wear", "lateral", (0.03, 0.12), rf"{TRIAL}|{rollers}", physical(wear)),
        Kind("a roller sticks in one trial", "lateral", (0.5, 2.0), rf"{TRIAL}|{rollers}",
            physical(stuck)),
        Kind("rollers' law bends", "lateral", (0.5, 2.0), rf"law|speed|{rollers}",
            physical(_true("roller_power"))),
        Kind("a cable pulls sideways", "lateral", (0.3, 1.5),
            rf"force|cable|direction|{rollers}|{lengths}", _true("side_pull")),
    ]  # fmt: skip
