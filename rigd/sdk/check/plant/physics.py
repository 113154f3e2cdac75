"""Checks the physics of a plant: its energy, its passivity, and the order of its integrator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.sdk.check.plant.bench import (
    CYCLES,
    Commands,
    PlantBench,
    PlantSubject,
    gentle,
    mirrored,
    strong,
)
from rigd.sdk.check.plant.rules import (
    ALTERED,
    PlantRule,
    needs_devices,
    needs_truth,
    other_parameters,
)
from rigd.sdk.plant import Energy

#: Share of the energy turned over that counts as rounding.
ROUNDING: Final = 1e-9
#: With parameters that are altered the step may fit less well: so many times less.
ALTERED_FACTOR: Final = 3.0
#: Halving the step must reduce the error by this share of what the order states. The rest allows
#: for effects that the order of a method does not cover: sticking, end stops.
SEEN: Final = 1 / 1.6


def needs_energy(subject: PlantSubject) -> str:
    """Return why the rules for energy cannot be applied."""
    if not subject.devices:
        return needs_devices(subject)
    return "" if subject.make().energy() is not None else "the plant states no energy()"


def needs_steps(subject: PlantSubject) -> str:
    """Return why the rule for the step cannot be applied."""
    if reason := needs_truth(subject):
        return reason
    return "" if subject.plant_class.step_ns is not None else "the plant states no step_ns"


def _driven(
    subject: PlantSubject, commands: Commands = gentle, cycles: int = CYCLES
) -> tuple[list[Energy], list[Energy]]:
    """Return the energy in every cycle: while the plant is driven, and once all is safe."""
    bench = PlantBench(subject, subject.make())
    bench.look()
    bench.play(cycles, commands)
    bench.make_safe()
    bench.play(CYCLES, None)
    return bench.seen.energy[: cycles + 1], bench.seen.energy[cycles + 1 :]


def turned_over(energies: Sequence[Energy]) -> float:
    """Return the energy in J that was moved in all."""
    return float(np.max(abs(_moved(energies))))


def _moved(energies: Sequence[Energy]) -> NDArray[np.float64]:
    """Return what was stored, supplied and dissipated since the first, in J, shape (3, n)."""
    table: NDArray[np.float64] = np.array(
        [(each.stored, each.supplied, each.dissipated) for each in energies]
    ).T
    return table - table[:, :1]


def _balances(subject: PlantSubject) -> Iterator[str]:
    yield from _balanced(subject, subject.accuracy)
    with other_parameters(subject) as other:
        if other is not None:
            for problem in _balanced(other, ALTERED_FACTOR * subject.accuracy):
                yield f"with each parameter altered by up to {100 * ALTERED:.0f} %, {problem}"


def _balanced(subject: PlantSubject, accuracy: float) -> Iterator[str]:
    moving, resting = _driven(subject)
    energies = [*moving, *resting]
    whole = turned_over(energies)
    if not whole > 0.0:
        yield "no energy is turned over although every setpoint moves"
        return
    if problem := unbalanced(energies, accuracy):
        yield problem


def unbalanced(energies: Sequence[Energy], accuracy: float) -> str:
    """Return by how much the energy does not balance within ``accuracy``; "" if it does."""
    whole = turned_over(energies)
    stored, supplied, dissipated = _moved(energies)
    excess = stored - supplied + dissipated
    at = int(np.argmax(abs(excess)))
    if abs(excess[at]) <= accuracy * whole:  # a NaN is a breach too
        return ""
    word = "created" if excess[at] > 0 else "lost"
    return (
        f"{abs(excess[at]):.3g} J of {whole:.3g} J are {word} within {at} looks; at most "
        f"{accuracy:.3g} of it may be"
    )


def _dissipates(subject: PlantSubject) -> Iterator[str]:
    for commands in (gentle, mirrored, strong):
        moving, resting = _driven(subject, commands, 2 * CYCLES)
        energies = [*moving, *resting]
        least = -ROUNDING * turned_over(energies)
        for cycle, (item, other) in enumerate(pairwise(energies)):
            back = item.dissipated - other.dissipated
            if back > -least:
                yield f"friction gives {back:.3g} J back after {cycle} ms"
                return


def _passive(subject: PlantSubject) -> Iterator[str]:
    moving, resting = _driven(subject)
    most = subject.accuracy * turned_over([*moving, *resting])
    stored, supplied, _ = _moved([moving[-1], *resting])
    for words, values in (
        ("the actuators supply", supplied), ("the stored energy rises by", stored),
    ):  # fmt: skip
        rises = values - np.minimum.accumulate(values)
        for cycle in np.flatnonzero(rises > most)[:1]:
            yield f"{words} {rises[cycle]:.3g} J within {cycle - 1} ms"


def _halved(subject: PlantSubject) -> Iterator[str]:
    step_ns, order = subject.plant_class.step_ns, subject.plant_class.order
    if step_ns is None:
        return
    coarse, fine, finest = (_truth(subject, step_ns // parts) for parts in (1, 2, 4))
    first, second = _distance(coarse, fine), _distance(fine, finest)
    if not first <= subject.accuracy:
        yield (
            f"half the step of {step_ns} ns changes the truth by {first:.3g} of its range; at "
            f"most {subject.accuracy:.3g} may be"
        )
    elif first > ROUNDING and not second <= first / (SEEN * 2.0**order):
        yield (
            f"halving the step changes the truth by {first:.3g} of its range, halving it again by "
            f"{second:.3g}: a ratio of {first / second:.2g}, expected {2**order} of order {order}"
        )


def _truth(subject: PlantSubject, step_ns: int) -> NDArray[np.float64]:
    plant = subject.make(step_ns=step_ns)
    return PlantBench(subject, plant).play(CYCLES, gentle).table(subject.truth)


def _distance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the rms difference of two tables over the range of each column, rms of all."""
    span = np.ptp(b, axis=0)
    moved = span > 0.0
    if not moved.any():
        return 0.0
    error = np.sqrt(np.mean((a - b)[:, moved] ** 2, axis=0)) / span[moved]
    return float(np.sqrt(np.mean(error**2)))


RULES: Final = (
    PlantRule(
        "energy balances",
        "stored energy changes by what actuators supply less what friction dissipates",
        _balances,
        needs_energy,
    ),
    PlantRule("friction takes", "dissipated energy never falls", _dissipates, needs_energy),
    PlantRule(
        "passive",
        "once every device is safe, nothing is supplied and the stored energy never rises",
        _passive,
        needs_energy,
    ),
    PlantRule(
        "halved step",
        "half of step_ns changes the hidden state by less than stated, at a rate of 2 to the "
        "power `order`",
        _halved,
        needs_steps,
    ),
)
