"""Makes the sensors, and refuses those that are outside their range at rest."""

from __future__ import annotations

from rigd.model.units import format_quantity
from rigd_sim.mechanism.amounts import Notes, Path, Wrong
from rigd_sim.mechanism.description import Description, Sensor
from rigd_sim.mechanism.network import (
    MEASURES,
    Instrument,
    Kind,
    Measure,
    Mechanism,
)


def instruments(given: Description, mechanism: Mechanism, notes: Notes) -> tuple[Instrument, ...]:
    """Return the sensors; what is wrong is noted."""
    found = []
    for name, sensor in given.sensors.items():
        try:
            found.append(_instrument(name, sensor, given, mechanism, notes))
        except Wrong:
            continue
    return tuple(found)


def _instrument(
    name: str, sensor: Sensor, given: Description, mechanism: Mechanism, notes: Notes
) -> Instrument:
    path = ("sensors", name)
    index, unit, factor, rest = _measured(path, sensor, given, mechanism, notes)
    low = notes.signed((*path, "low"), sensor.low, unit)
    high = notes.signed((*path, "high"), sensor.high, unit)
    if low >= high:
        raise notes.refuse(
            (*path, "high"), f"'{sensor.high}' must be more than 'low', {sensor.low}"
        )
    zero = notes.signed((*path, "zero"), sensor.zero, unit, difference=True)
    if not low <= rest + zero <= high:
        raise notes.refuse(
            path,
            f"{name} reads {format_quantity(rest + zero, unit)} at rest, outside its range of "
            f"{sensor.low} to {sensor.high}",
        )

    def size(key: str, text: str) -> float:
        return notes.amount((*path, key), text, unit, high=high - low, difference=True)

    return Instrument(
        name=name,
        measure=MEASURES[sensor.measures],
        index=index,
        unit=unit,
        factor=factor,
        low=low,
        high=high,
        noise=size("noise", sensor.noise),
        resolution=size("resolution", sensor.resolution),
        zero=zero,
        bandwidth=sensor.bandwidth or 0.0,
    )


def _measured(
    path: Path, sensor: Sensor, given: Description, mechanism: Mechanism, notes: Notes
) -> tuple[int, str, float, float]:
    """Return index and unit of what is measured, its factor, and its value at the start."""
    spot, measure = (*path, "of"), sensor.measures
    if measure in ("position", "speed"):
        notes.known(spot, sensor.of, mechanism.axes, "body")
        axis = mechanism.axes[sensor.of]
        moving = measure == "speed"
        rest = mechanism.speeds[axis.dof] * axis.factor if moving else axis.start
        unit = f"{axis.unit}/s" if moving else axis.unit
        return list(mechanism.axes).index(sensor.of), unit, 1.0, rest
    if measure == "temperature":
        notes.known(spot, sensor.of, given.temperatures, "temperature")
        return list(given.temperatures).index(sensor.of), "K", 1.0, mechanism.ambient
    among = {
        "load": [name for name, item in given.friction.items() if item.load or item.pressed_by],
        "current": [name for name, item in given.drives.items() if item.mode == "current"],
    }.get(measure, [*given.springs, *given.friction, *given.drives])
    kinds = {"load": "friction with a load", "current": "drive of mode current"}
    notes.known(spot, sensor.of, among, kinds.get(measure, "spring, friction or drive"))
    index, element = mechanism.index[sensor.of], mechanism.element(sensor.of)
    if MEASURES[measure] == Measure.LOAD:
        return index, "N", 1.0, element.load
    if MEASURES[measure] == Measure.CURRENT:
        return index, "A", 1.0, 0.0
    # A drive shows the force that it gives, anything else the force in it.
    factor = -1.0 if element.kind >= Kind.CURRENT else 1.0
    if measure == "force" and element.force_unit == "N m":
        raise notes.refuse((*path, "measures"), f"{sensor.of} has a torque: measure 'torque'")
    if measure == "torque" and element.force_unit == "N":
        if element.radius == 0.0:
            raise notes.refuse((*path, "measures"), f"{sensor.of} has a force: measure 'force'")
        factor *= element.radius
    unit = "N" if measure == "force" else "N m"
    return index, unit, factor, factor * element.at_start
