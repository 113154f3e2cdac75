"""Designs tests of the omni-wheel rig for the intervals that output error gives."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis import ConfigError, DataError, parse_quantity, parse_unit
from rigd.analysis.design.command import Designed, DesignRequest, Ground, Promise
from rigd.analysis.design.optimal import DesignTarget, PossibleTest, choose, half_widths
from rigd.analysis.result import FloatArray, IdentificationResult
from rigd.analysis.validation.saved_models import SavedModel
from rigd_analyses.lugre.design.motion import Limits, Motion, Sensors, moves, refusal
from rigd_analyses.lugre.design.procedure import written
from rigd_analyses.lugre.design.shapes import Kind, Shape, shapes
from rigd_analyses.lugre.design.subject import QUANTITIES, Subject, obtained, slip_of
from rigd_analyses.lugre.model import PARAMETERS, V_S
from rigd_analyses.lugre.needs import DRIVE
from rigd_analyses.lugre.reading import CONSTANTS, FRICTION_MASS, MASS, WITH_MASS, known_constants
from rigd_analyses.lugre.rig import sensors as rows
from rigd_analyses.lugre.rig.parts import LEAST_TRIALS
from rigd_analyses.lugre.rig.system import FITTED_NAMES
from rigd_analyses.lugre.validation.friction import AGAIN, POINT, Friction, friction_of

DEFAULT = (*QUANTITIES, "g@5mm/s", "g@10mm/s", "g@20mm/s", "g@50mm/s")
OPEN = math.log(2.0)  #: half width beyond which a quantity is not identifiable: a factor of two
PREPARED_S = 1.8  #: before the first and behind the last trial
FAR = 8.0  #: of its stated uncertainties: farther off, a fitted mass is another one
SAME_MASS = 0.01  #: relative difference that no prediction shows
APART = 0.1  #: relative distance of a target's slip from the ends of what is visited
LONG = "longer than the time given"
SETTINGS = ("preprocessing", "settings")


@dataclass(frozen=True, eq=False)
class _Offer:
    """A shape that all subjects allow, its motion on each, and what it tells of each."""

    shape: Shape
    motions: tuple[Motion, ...]
    test: PossibleTest


def design(request: DesignRequest, notify: Callable[[str], None]) -> Designed:
    """Return the tests for ``request``.

    Raises:
        ConfigError: a model has no friction or no noise, or a target is unknown.
        DataError: the time is too short, or no test reaches a target.
    """
    names = tuple(_checked(name) for name in request.targets) or DEFAULT
    subjects = [subject_of(ground) for ground in request.grounds]
    base = _base_shapes(request)
    travel = max(shape.stop_at_m for shape in base)
    largest = min(
        max(shape.current_a for shape in base),
        *(ground.limits["motor_current"][1] for ground in request.grounds),
    )
    notify(f"what each of the tests tells of {', '.join(subject.name for subject in subjects)}")
    budget_s = request.budget_s - PREPARED_S
    lowest = max(ground.limits["motor_current"][0] for ground in request.grounds)
    tried = [shape for shape in shapes(largest, travel) if shape.lowest_a >= lowest]
    offers, left_out = _offers(subjects, tried, budget_s)
    if not offers:
        raise DataError(
            f"no test fits: of {sum(left_out.values())}, {_counted(left_out)}",
            hint="give more minutes" if LONG in left_out else None,
        )
    known = _known(subjects, offers[0])
    aimed, beyond = _targets(subjects, offers, known, names)
    chosen = _chosen(subjects, offers, known, aimed, budget_s)
    if len(chosen) < LEAST_TRIALS:
        raise DataError(
            f"{request.budget_s:.3g} s are enough for {len(chosen)} tests; an identification needs "
            f"{LEAST_TRIALS}",
            hint="give more minutes",
        )
    picked = sorted(offer.shape for offer in chosen)
    driven_s = sum(offer.test.duration_s for offer in chosen)
    promises = _promises(subjects, picked, base, known, names, driven_s, notify)
    seconds = driven_s + PREPARED_S
    notes = (
        f"{len(offers) + sum(left_out.values())} tests were tried on the model; "
        + _counted(left_out),
        *beyond,
    )
    text = written(
        request.base, request.name, _title(len(picked)), _doc(seconds), picked, request.signals,
        [subject.name for subject in subjects],
    )  # fmt: skip
    return Designed(text, len(picked), seconds, tuple(promises), notes)


def _title(count: int) -> str:
    return f"{count} tests designed for the LuGre parameters and g"


def _doc(seconds: float) -> str:
    return (
        "Shapes: a current that is held; one that changes, or turns to brake; a ramp; swings to\n"
        "and fro. Evaluate it with `rigd identify FILE`.\n"
        f"It takes {seconds:.0f} s of rig time, as predicted.\n"
    )


def _checked(name: str) -> str:
    """Return a target by its name without spaces.

    Raises:
        ConfigError: there is no such target.
    """
    short = name.replace(" ", "")
    if short in QUANTITIES:
        return short
    if short.startswith("g@"):
        try:
            slip = parse_quantity(short[2:])
        except ValueError as error:
            raise ConfigError(f"--for {name}: {error}") from error
        if slip.unit.same_kind(parse_unit("m/s")) and slip.value > 0.0:
            return short
    raise ConfigError(
        f"--for {name}: there is no such target",
        hint=f"there are: {', '.join(QUANTITIES)}, and g at a slip, such as g@50mm/s",
    )


def subject_of(ground: Ground) -> Subject:
    """Return what is known of one group.

    Raises:
        ConfigError: the model has another law or mass, or was not identified by output error.
    """
    saved = ground.model
    names = tuple(item.name for item in PARAMETERS)
    if saved.get(*POINT) is not None and saved.texts(*POINT, "names") != names:
        raise saved.error(
            "tests are designed for the law lugre alone: output error has the sensitivities of no "
            "other",
            POINT,
            hint="identify without --law",
        )
    if saved.get(*SETTINGS, rows.CURRENT_NOISE) is None:
        raise saved.error(
            f"{saved.name} does not say what noise the sensors have: it was not identified by "
            "output error, or by an earlier version of rigd",
            SETTINGS,
            hint="rigd identify FILE --json > model.json",
        )
    if missing := [name for name in (*CONSTANTS, *DRIVE) if name not in ground.constants]:
        raise saved.error(f"the base procedure gives no constant {', '.join(missing)}", ())
    friction = friction_of(saved)

    def row(name: str) -> float:
        return saved.number(*SETTINGS, name)

    share = 1.0
    if FRICTION_MASS in ground.constants:
        share = ground.constants["mass"] / ground.constants[FRICTION_MASS]
    values = dict(ground.constants)
    for name in (name for name in WITH_MASS if name in values):
        values[name] *= share
    settings = saved.get(*SETTINGS)
    given = settings if isinstance(settings, dict) else {}
    wanted = [rows.FITTED + name for name in FITTED_NAMES if name != MASS]
    if missing := [name for name in wanted if name not in given]:
        raise saved.error(
            f"the model lacks {missing[0]!r}, which output error fits", SETTINGS, hint=AGAIN
        )
    fitted = [row(name) for name in wanted]
    # A model that was saved before the mass had an uncertainty took it as stated.
    fitted.append(row(rows.FITTED + MASS) if rows.FITTED + MASS in given else values[MASS])
    constants = known_constants(values, ground.uncertainties, share)
    mass, now = fitted[-1], constants.mass
    if abs(mass - now.value) > max(FAR * now.u, SAME_MASS * now.value):
        raise saved.error(
            f"{saved.name} is of a carriage of {mass:.5g} kg, the rig has now {now.value:.5g} kg",
            (*SETTINGS, rows.FITTED + MASS),
            hint="friction and drag were fitted with that mass: identify a recording with the "
            "present one",
        )
    limited = saved.get(*SETTINGS, rows.VOLTAGE_AT_REST) is not None
    sensors = Sensors(
        row(rows.PERIOD), row(rows.CURRENT_NOISE), row(rows.ANGLE_COUNT), row(rows.POSITION_COUNT),
        row(rows.ACCELERATION_NOISE),
        *((row(rows.VOLTAGE_AT_REST), row(rows.VOLTAGE_SLOPE)) if limited else ()),
    )  # fmt: skip
    low, high = ground.limits["carriage_position"]
    return Subject(
        saved.group or "the model",
        np.append(friction.theta, fitted),
        sensors,
        constants,
        Limits(low, high, row(rows.TOP_SPEED)),
        _other(saved, friction),
    )


def _other(saved: SavedModel, friction: Friction) -> FloatArray | None:
    """Return the accepted friction (6,) whose V_s is farthest from the point's, if V_s is open."""
    if saved.get("parameters", "V_s", "low") is not None or not len(friction.alternatives):
        return None
    away = np.abs(np.log(friction.alternatives[:, V_S] / friction.theta[V_S]))
    return np.asarray(friction.alternatives[int(np.argmax(away))])


def _base_shapes(request: DesignRequest) -> list[Shape]:
    """Return the tests of the base procedure: constant currents.

    Raises:
        ConfigError: its trials are others.
    """
    found = []
    for trial in request.grounds[0].trials:
        numbers = [trial.get(name) for name in ("current", "brake_at", "longest_drive")]
        if not all(isinstance(value, int | float) for value in numbers):
            raise ConfigError(
                f"the trials of {request.base_name} must have the parameters current, brake_at "
                "and longest_drive",
                hint="give a procedure such as constant_current with --base",
            )
        current, stop, longest = (float(value) for value in numbers if value is not None)
        found.append(Shape(Kind.HOLD.value, current, stop, longest))
    return found


def _offers(
    subjects: Sequence[Subject], tried: Sequence[Shape], budget_s: float
) -> tuple[list[_Offer], Counter[str]]:
    """Return the tests that every subject allows, and how many are left out for each reason."""
    offers, left_out = [], Counter[str]()
    for shape in tried:
        motions = tuple(subject.motion(shape) for subject in subjects)
        pairs = list(zip(subjects, motions, strict=True))
        reasons = [refusal(motion, subject.limits) for subject, motion in pairs]
        reasons += [LONG] * any(motion.duration_s > budget_s for motion in motions)
        if any(reasons):
            left_out[next(filter(None, reasons))] += 1
            continue
        offers.append(_Offer(shape, motions, _test(shape, pairs)))
    return offers, left_out


def _test(shape: Shape, pairs: Sequence[tuple[Subject, Motion]]) -> PossibleTest:
    each = [subject.offered(shape, motion) for subject, motion in pairs]
    return PossibleTest(
        np.concatenate([item.information for item in each]), max(item.duration_s for item in each)
    )


def _chosen(
    subjects: Sequence[Subject],
    offers: Sequence[_Offer],
    known: FloatArray,
    aimed: Sequence[DesignTarget],
    budget_s: float,
) -> list[_Offer]:
    """Return the chosen tests; they visit every slip at which g is a target.

    Information alone may leave out a slip that a model extrapolates to: the estimator gives no g
    there. The test that visits most of it is then taken first, and the others anew.
    """
    first: list[_Offer] = []
    while True:
        have = known + sum(offer.test.information for offer in first)
        left_s = budget_s - sum(offer.test.duration_s for offer in first)
        fits = [offer for offer in offers if offer.test.duration_s <= left_s]
        counts = choose([offer.test for offer in fits], have, aimed, left_s).counts if fits else ()
        found = [*first, *(o for o, count in zip(fits, counts, strict=True) for _ in range(count))]
        best = _missing(subjects, found, fits, aimed)
        if best is None:
            return found
        first.append(best)


def _missing(
    subjects: Sequence[Subject],
    found: Sequence[_Offer],
    fits: Sequence[_Offer],
    aimed: Sequence[DesignTarget],
) -> _Offer | None:
    """Return the test that visits most of a slip that ``found`` do not; None if they visit all."""
    for target in aimed:
        at = slip_of(target.name)
        if at is None:
            continue
        group, subject = target.group, subjects[target.group]
        low, high = subject.visited([offer.motions[group] for offer in found])
        sides = {-1: low > at * (1.0 - APART), 1: high < at * (1.0 + APART)}
        for side in (side for side, missing in sides.items() if missing):
            edge = at * (1.0 + side * APART)
            beyond = [
                np.count_nonzero(side * subject.slip(offer.motions[group]) > side * edge)
                / offer.test.duration_s
                for offer in fits
            ]
            if beyond and max(beyond) > 0.0:
                return fits[int(np.argmax(beyond))]
    return None


def _known(subjects: Sequence[Subject], offer: _Offer) -> FloatArray:
    found = [
        subject.known(subject.system([offer.shape], [motion]))
        for subject, motion in zip(subjects, offer.motions, strict=True)
    ]
    return np.concatenate(found)


def _targets(
    subjects: Sequence[Subject], offers: Sequence[_Offer], known: FloatArray, names: Sequence[str]
) -> tuple[list[DesignTarget], list[str]]:
    """Return what the tests can be chosen for, and a sentence on each target that they cannot.

    Raises:
        DataError: no target is left.
    """
    most = known + sum(offer.test.information for offer in offers)
    aimed, beyond = [], []
    for group, subject in enumerate(subjects):
        visited = subject.visited([offer.motions[group] for offer in offers])
        for name in names:
            target = subject.target(name, group, known.shape[-1])
            why = subject.beyond(name, visited)
            if not why and half_widths(most, [target])[0] > OPEN:
                why = "all tests together leave more than a factor of two"
            if why:
                beyond.append(f"no test determines {name} of {subject.name}: {why}")
            else:
                aimed.append(target)
    if not aimed:
        raise DataError("; ".join(beyond), hint="ask for other targets with --for")
    return aimed, beyond


def _promises(
    subjects: Sequence[Subject],
    picked: Sequence[Shape],
    base: Sequence[Shape],
    known: FloatArray,
    names: Sequence[str],
    seconds: float,
    notify: Callable[[str], None],
) -> list[Promise]:
    """Return what the estimator gives on predicted recordings of the tests, by target.

    Beside it stands what the information of the base's own tests gives in ``seconds``.
    """
    promises = []
    for group, subject in enumerate(subjects):
        outcomes = [item.predicted(picked, notify) for item in subject.possible]
        ranges = [
            item.visited([item.motion(shape) for shape in picked]) for item in subject.possible
        ]
        motions = {shape: subject.motion(shape) for shape in base}
        moving = {shape: motion for shape, motion in motions.items() if moves(motion)}
        sweeps = seconds / sum(motion.duration_s for motion in motions.values())
        once = sum(subject.offered(*item).information for item in moving.items())
        visited = subject.visited(list(moving.values()))
        for name in names:
            target = subject.target(name, 0, known.shape[-1])
            width = float(half_widths(known[group : group + 1] + sweeps * once, [target])[0])
            is_open = width > OPEN or subject.beyond(name, visited)
            extrapolated = any(
                item.beyond(name, within)
                for item, within in zip(subject.possible, ranges, strict=True)
            )
            promises.append(
                Promise(
                    subject.name, name, None if extrapolated else _widest(outcomes, name),
                    None if is_open else width,
                )
            )  # fmt: skip
    return promises


def _widest(outcomes: Sequence[IdentificationResult], name: str) -> float | None:
    """Return the widest half width; None if one of them is open."""
    widths = [obtained(outcome, name) for outcome in outcomes]
    known = [width for width in widths if width is not None]
    return max(known) if len(known) == len(widths) else None


def _counted(left_out: Counter[str]) -> str:
    if not left_out:
        return "all of them stay within the rig's limits"
    counts = ", ".join(f"{count} ({reason})" for reason, count in left_out.items())
    return f"left out: {counts}"
