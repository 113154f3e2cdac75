"""Lists possible errors of the model of the omni-wheel rig beyond its constants.

Each has a name, or is a dependence on some quantity, and is given as the change of the outputs for
each unit of it, at the fitted motion (:mod:`.disturbances`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rigd.analysis.output_error.score import Columns
from rigd.analysis.output_error.structure import (
    ANY,
    POSITIVE,
    Context,
    ErrorSource,
    Suspect,
    dependences,
)
from rigd.analysis.result import FloatArray, Meaning
from rigd_analyses.lugre.model import RATIO
from rigd_analyses.lugre.rig.disturbances import Disturbed, Motion
from rigd_analyses.lugre.rig.system import LEAD, RigSystem

WARMING_S = 0.3  #: time over which friction may change within a drive
LEAST_SLIP_M_S = 1e-4  #: below it friction is at rest
STICTION_M_S = 0.02  #: speed over which the guide's static friction falls
ORDERS = tuple(n for n in range(1, 41))  #: per turn of the wheel, of a force
SHORTEST_M = 0.03  #: of what may repeat along the guide
SHORTEST_FLOOR_M = 0.1  #: and of what may repeat on the floor
PERIODS = 4.0  #: that the longest travel shows, or it is not known to repeat
RESOLVED = 0.5  #: of one wave more along the longest travel
NEAR = 13  #: lengths between two neighbours that a winner is refined with
MAINS_HZ = (50.0, 60.0)
#: Largest sizes that a cause can have; with a larger one it is not the cause.
LATEST = (-0.1, 0.1)  #: s, of a delay: a slower filter leaves no motion to identify
LOOSEST_RAD = 0.2  #: of backlash: more than 10 degrees are heard
#: Standard uncertainty of the exponent 1/2 of Eq. 6, which no paper states. Of 0.45 the data of six
#: trials on PVC may show nothing, and V_s was 2 to 4 half widths off.
EXPONENT_U = 0.05
OFF_CENTRE = 0.1  #: eccentricity of a wheel over its radius

FRICTION = "friction"
WEAR = "friction that changes from the first trial to the last"
#: Things that differ between trials: what they are called beside friction that depends on them.
BY_TRIAL = (
    WEAR,
    f"{FRICTION} that depends on the trial",
    f"{FRICTION} that depends on the recording",
)
#: Of what kind things are that are easily taken for one another.
LIKE = dict.fromkeys(BY_TRIAL, "by trial")
#: What to check if friction differs between trials.
BETWEEN = (
    "wear, dirt or warming of wheel and floor, how long the contact rested before each trial, and "
    "what was changed between them"
)
SLIP = "the slip"  #: an error that depends on it changes the motion as friction does
#: What a law of friction holds; friction that depends on it otherwise follows another law.
LAWS = ("the speed", "the slip", "the current", "the acceleration")

Signal = Callable[[Motion], FloatArray]


def candidates(system: RigSystem, theta: FloatArray) -> Iterator[Suspect]:
    """Yield what may be wrong, at the parameters ``theta`` (p,) of ``system``."""
    return suspects(Disturbed(system, theta))


def suspects(rig: Disturbed) -> Iterator[Suspect]:
    """Yield what may be wrong with a rig that moves along the guide."""
    for item in _all(rig):
        yield replace(item, like=LIKE.get(item.name, item.like))


def _all(rig: Disturbed) -> Iterator[Suspect]:
    yield from _special(rig)
    by_slip = {
        item.name: replace(item, u=0.0)  # any curve would do: the exponent has what stays open
        for item in dependences([contact(rig)], [_decades(rig)])
    }
    for pair in dependences(sources(rig), contexts(rig)):
        item = by_slip.get(pair.name, pair)
        if item.name.startswith(FRICTION):
            meaning = Meaning.LAW if item.name.endswith(LAWS) else Meaning.VARIES
            look = BETWEEN if item.name in BY_TRIAL else item.look
            yield replace(item, meaning=meaning, look=look)
        elif item.name.endswith(SLIP):
            yield replace(item, meaning=Meaning.CONFUSED)
        else:
            yield item
    yield from _repeating(rig)


def sources(rig: Disturbed) -> list[ErrorSource]:
    """Return the places at which an error may enter: readings, forces, the contact."""
    gain = rig.named["drive_gain"]
    return [
        ErrorSource("a force on the carriage", "N", lambda k, s: rig.forced(k, force_n=s)),
        ErrorSource("an error of the current", "A", lambda k, s: rig.forced(k, torque_nm=gain * s)),
        contact(rig),
        ErrorSource("an error of the carriage encoder", "m", lambda k, s: rig.readings(position=s)),
        ErrorSource("an error of the wheel encoder", "rad", lambda k, s: rig.readings(angle=s)),
        ErrorSource(
            "an error of the accelerometer", "m/s^2", lambda k, s: rig.readings(acceleration=s)
        ),
    ]


def contact(rig: Disturbed) -> ErrorSource:
    """Return the friction of the contact as the place of an error."""
    return ErrorSource(FRICTION, "1", lambda k, s: rig.rubbed(k, friction_share=s))


def _decades(rig: Disturbed) -> Context:
    """Return the slip as laws of friction depend on it: over its decades, either way alike.

    Over the slip itself four cosines do not show what happens below V_s.
    """
    slips = [np.maximum(np.abs(motion.slip), LEAST_SLIP_M_S) for motion in rig.motions]
    return Context(SLIP, [np.log(slip) for slip in slips])


def contexts(rig: Disturbed) -> list[Context]:
    """Return what an error may depend on."""

    def of(name: str, signal: Signal, *, round_rad: bool = False) -> Context:
        return Context(name, [signal(motion) for motion in rig.motions], round_rad)

    recordings = [item.trial.recording for item in rig.system.trials]
    numbers = {name: float(k) for k, name in enumerate(dict.fromkeys(recordings))}
    motions = rig.motions
    return [
        of("the time in a trial", lambda m: m.time),
        of("the position", lambda m: m.position),
        of("the speed", lambda m: m.speed),
        of("the slip", lambda m: m.slip),
        of("the current", lambda m: m.current),
        of("the acceleration", lambda m: m.acceleration),
        of("the wheel's angle", lambda m: m.angle, round_rad=True),
        Context("the direction", [np.sign(m.speed) * m.moving for m in motions], groups=True),
        Context("the direction of the slip", [np.sign(m.slip) * m.moving for m in motions],
                groups=True),
        Context("the trial", [np.full(m.time.size, float(k)) for k, m in enumerate(motions)],
                groups=True),
        Context("the recording", [np.full(m.time.size, numbers[name])
                                  for m, name in zip(motions, recordings, strict=True)],
                groups=True),
    ]  # fmt: skip


def _special(rig: Disturbed) -> Iterator[Suspect]:
    """Yield the things that have a name."""
    named, period = rig.named, rig.system.period_s
    gain, radius = named["drive_gain"], named["wheel_radius"]
    count = len(rig.motions)

    def yielded(
        name: str, unit: str, look: str, respond: Callable[[int, Motion], FloatArray],
        meaning: Meaning = Meaning.NUISANCE, possible: tuple[float, float] = ANY,
    ) -> Suspect:  # fmt: skip
        def columns() -> Columns:
            return [respond(k, motion) for k, motion in enumerate(rig.motions)]

        return Suspect(name, unit, columns, look, special=True, meaning=meaning, possible=possible)

    def position(name: str, unit: str, look: str, signal: Signal) -> Suspect:
        return yielded(name, unit, look, lambda k, m: rig.readings(position=signal(m)[:, None]))

    def angle(
        name: str, unit: str, look: str, signal: Signal, possible: tuple[float, float] = ANY
    ) -> Suspect:
        return yielded(
            name, unit, look, lambda k, m: rig.readings(angle=signal(m)[:, None]), possible=possible
        )

    def resisting(name: str, unit: str, look: str, signal: Signal) -> Suspect:
        return yielded(
            name, unit, look, lambda k, m: rig.forced(k, force_n=signal(m)[:, None]),
            possible=POSITIVE,
        )  # fmt: skip

    def current(
        name: str, unit: str, look: str, signal: Signal, possible: tuple[float, float] = ANY
    ) -> Suspect:
        return yielded(
            name, unit, look, lambda k, m: rig.forced(k, torque_nm=gain * signal(m)[:, None]),
            possible=possible,
        )  # fmt: skip

    def friction(
        name: str, look: str, signal: Signal, meaning: Meaning = Meaning.VARIES
    ) -> Suspect:
        return yielded(
            name, "1", look, lambda k, m: rig.rubbed(k, friction_share=signal(m)[:, None]), meaning
        )

    def driven(motion: Motion) -> FloatArray:
        return np.maximum(motion.time - LEAD * period, 0.0)

    yield position(
        "another scale of the carriage encoder",
        "1",
        "the radius of the measuring wheel",
        lambda m: m.position,
    )
    yield position(
        "a clock of the carriage encoder that gains",
        "1",
        "whether both encoders share one clock",
        lambda m: m.speed * m.time,
    )
    yield angle(
        "a clock of the wheel encoder that gains",
        "1",
        "whether both encoders share one clock",
        lambda m: m.turning * m.time,
    )
    yield position(
        "a measuring wheel that slips with the acceleration",
        "s^2/m",
        "how firmly the measuring wheel is pressed",
        lambda m: -period * np.cumsum(np.abs(m.acceleration) * m.speed),
    )
    yield angle(
        "backlash of the gear",
        "rad",
        "the play of the gear and of the wheel's key",
        lambda m: 0.5 * np.sign(gain * m.current - named["no_load"] * np.sign(m.turning)),
        (0.0, LOOSEST_RAD),
    )
    yield angle(
        "a shaft between motor and wheel that winds up",
        "rad/(N m)",
        "the stiffness of the gear, the coupling and the key",
        lambda m: gain * m.current,
        POSITIVE,
    )
    yield yielded(
        "a zero of the accelerometer that drifts",
        "m/s^3",
        "the accelerometer's temperature",
        lambda k, m: rig.readings(acceleration=m.time[:, None]),
    )
    yield current(
        "a delay of the current",
        "s",
        "the filter of the current monitor, the amplifier's loop",
        lambda m: np.gradient(m.current, period),
        LATEST,
    )
    yield current(
        "a zero of the current that drifts", "A/s", "the current monitor", lambda m: driven(m)
    )
    yield current(
        "a drive that fades as it lasts",
        "1/s",
        "the motor's temperature",
        lambda m: -m.current * driven(m),
    )
    yield current(
        "a drive that fades as it heats",
        "1/(A^2 s)",
        "the motor's temperature",
        lambda m: -m.current * period * np.cumsum(m.current**2),
    )
    yield current(
        "a drive or monitor that saturates",
        "1/A",
        "the ranges of amplifier and converter",
        lambda m: -m.current * np.abs(m.current),
    )
    yield current(
        "a gear that loses less when it is driven back",
        "1",
        "the gear's efficiency both ways",
        lambda m: (
            (m.current - named["no_load"] / gain * np.sign(m.turning))
            * (m.current * m.turning <= 0.0)
        ),
    )
    yield resisting(
        "drag with the square of the speed",
        "N s^2/m^2",
        "cables and covers",
        lambda m: -m.speed * np.abs(m.speed),
    )
    yield resisting(
        "a guide that sticks",
        "N",
        "the guide's carriages, their grease and preload",
        lambda m: -np.tanh(m.speed / 1e-3) * np.exp(-np.abs(m.speed) / STICTION_M_S),
    )
    yield yielded(
        "a drive wheel out of centre",
        "m",
        "the runout of the wheel",
        lambda k, m: _other_radius(rig, k, _circle(m.angle)),
        possible=(-OFF_CENTRE * radius, OFF_CENTRE * radius),
    )
    yield yielded(
        "a drive wheel that grows with the square of the speed",
        "s^2/m",
        "whether its rollers and their bearings give way to the centrifugal force",
        lambda k, m: _other_radius(rig, k, ((radius * m.turning) ** 2)[:, None]),
        possible=POSITIVE,
    )
    exponent = friction(
        "another exponent of the Stribeck effect", "a model with that exponent",
        lambda m: _by_exponent(rig, m), Meaning.LAW,
    )  # fmt: skip
    yield replace(exponent, u=EXPONENT_U)
    yield yielded(
        "bristles that leave the contact as the wheel rolls", "1/m", "a model with relaxation",
        lambda k, m: rig.rubbed(k, bristle=-(radius * np.abs(m.turning) * m.bristle)[:, None]),
        Meaning.LAW,
    )  # fmt: skip
    yield friction(
        "friction that falls as the drive lasts",
        "the temperature of wheel and floor",
        lambda m: -(1.0 - np.exp(-driven(m) / WARMING_S)),
    )
    if count > 1:
        order = {id(m): k / (count - 1) - 0.5 for k, m in enumerate(rig.motions)}
        yield friction(
            WEAR,
            "wear or dirt of wheel and floor, their temperature",
            lambda m: np.full(m.time.size, order[id(m)]),
        )
        yield yielded(
            "bristle stiffness that changes from the first trial to the last",
            "1",
            "wear of the rollers, their temperature",
            lambda k, m: rig.rubbed(
                k, bristle=order[id(m)] * (named["sigma_0"] * _sliding(m))[:, None]
            ),
            Meaning.VARIES,
        )


def _repeating(rig: Disturbed) -> Iterator[Suspect]:
    """Yield what comes back with the wheel's turns, along the guide, or with the mains."""
    for order in ORDERS:
        yield Suspect(
            f"a force {order} times a turn of the wheel, with the speed", "N s/m",
            partial(_shaking, rig, order), "gear, bearings and rollers of the wheel", special=True,
        )  # fmt: skip
    travel = max(float(np.ptp(motion.position)) for motion in rig.motions)
    step = RESOLVED / travel
    for repeated, shortest_m in ((_repeated_reading, SHORTEST_M), (_waves, SHORTEST_FLOOR_M)):
        for waves_m in np.arange(PERIODS / travel, 1.0 / shortest_m, step):
            item = repeated(rig, float(waves_m))
            yield replace(item, near=partial(_near, repeated, rig, float(waves_m), step))
    for mains_hz in MAINS_HZ:
        hum = f"a hum of {mains_hz:.0f} Hz"
        yield Suspect(
            f"{hum} on the current", "A", partial(_humming, rig, mains_hz),
            "earth and screen of the current monitor", special=True, each_trial=True, like=hum,
        )  # fmt: skip
        yield Suspect(
            f"{hum} on the accelerometer", "m/s^2", partial(_felt_hum, rig, mains_hz),
            "earth and screen of the accelerometer", special=True, each_trial=True, like=hum,
        )  # fmt: skip


def _near(
    repeated: Callable[[Disturbed, float], Suspect], rig: Disturbed, waves_m: float, step: float
) -> Iterator[Suspect]:
    """Yield what repeats ``waves_m`` times a metre, and its neighbours up to ``step``."""
    for share in np.linspace(-0.9, 0.9, NEAR):
        yield repeated(rig, waves_m + float(share) * step)


def _repeated_reading(rig: Disturbed, waves_m: float) -> Suspect:
    """Return an error of the carriage encoder that repeats ``waves_m`` times a metre."""
    most = OFF_CENTRE / (2.0 * np.pi * waves_m)
    return Suspect(
        f"an error of the carriage encoder each {1e3 / waves_m:.1f} mm", "m",
        partial(_along, rig, waves_m),
        "the runout of the measuring wheel (its turn is 2 pi times its radius)",
        special=True, each_trial=True, possible=(-most, most),
    )  # fmt: skip


def _waves(rig: Disturbed, waves_m: float) -> Suspect:
    """Return friction that repeats ``waves_m`` times a metre."""
    return Suspect(
        f"{FRICTION} that repeats each {1e3 / waves_m:.1f} mm", "1",
        partial(_rubbing, rig, waves_m), "tiles, joints and dirt of the floor", special=True,
        meaning=Meaning.VARIES, possible=(-1.0, 1.0),
    )  # fmt: skip


def _shaking(rig: Disturbed, order: int) -> Columns:
    return [
        rig.forced(k, force_n=m.speed[:, None] * _circle(order * m.angle))
        for k, m in enumerate(rig.motions)
    ]


def _along(rig: Disturbed, waves_m: float) -> Columns:
    return [rig.readings(position=_circle(2.0 * np.pi * waves_m * m.position)) for m in rig.motions]


def _rubbing(rig: Disturbed, waves_m: float) -> Columns:
    return [
        rig.rubbed(k, friction_share=_circle(2.0 * np.pi * waves_m * m.position))
        for k, m in enumerate(rig.motions)
    ]


def _humming(rig: Disturbed, mains_hz: float) -> Columns:
    gain = rig.named["drive_gain"]
    return [
        rig.forced(k, torque_nm=gain * _circle(2.0 * np.pi * mains_hz * m.time))
        for k, m in enumerate(rig.motions)
    ]


def _felt_hum(rig: Disturbed, mains_hz: float) -> Columns:
    return [
        rig.readings(acceleration=_circle(2.0 * np.pi * mains_hz * m.time)) for m in rig.motions
    ]


def _circle(phase: FloatArray) -> FloatArray:
    return np.stack([np.cos(phase), np.sin(phase)], axis=1)


def _sliding(motion: Motion) -> FloatArray:
    """Return the rate of the bristle over sigma_0, u = V - |V| z/g."""
    return motion.slip - np.abs(motion.slip) * motion.bristle / motion.g


def _other_radius(rig: Disturbed, trial: int, more: FloatArray) -> FloatArray:
    """Return the outputs (n, 3, c) for each metre by which the radius is larger, times ``more``."""
    motion, named = rig.motions[trial], rig.named
    v_s, ratio = named["V_s"], named["ln(mu_s/mu_c)"]
    root = np.sqrt(np.abs(motion.slip) / v_s)
    bend = 0.5 * named["mu_c"] * np.expm1(ratio) * np.exp(-root) * root
    stress = motion.bristle / motion.g
    by_slip = 1.0 - np.sign(motion.slip) * stress * (1.0 + bend / motion.g)
    slip = more * motion.turning[:, None]
    moved = rig.rubbed(
        trial,
        traction=named["sigma_2"] * slip,
        bristle=(named["sigma_0"] * by_slip)[:, None] * slip,
    )
    pull = motion.bristle + named["sigma_1"] * _sliding(motion) + named["sigma_2"] * motion.slip
    normal = rig.system.normal_force_n(trial)
    return moved + rig.forced(trial, torque_nm=-(normal * pull)[:, None] * more)


def _by_exponent(rig: Disturbed, motion: Motion) -> FloatArray:
    """Return d(ln g)/d(exponent) at the exponent 1/2 of Eq. 6."""
    named = rig.named
    share = np.maximum(np.abs(motion.slip) / named["V_s"], 1e-12)
    root = np.sqrt(share)
    rise = named["mu_c"] * np.expm1(rig.shared[RATIO]) * np.exp(-root)
    return np.asarray(-rise * root * np.log(share) / motion.g)
