"""Assembles a description: every unit read, every name found, or every reason why it cannot be."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Self

from pydantic import model_validator

from rigd_sim.mechanism.amounts import Notes, Wrong
from rigd_sim.mechanism.bodies import Moving, moving
from rigd_sim.mechanism.description import Description, Friction, Spring
from rigd_sim.mechanism.drives import drive
from rigd_sim.mechanism.ends import Strain, between_two, of_body
from rigd_sim.mechanism.instruments import instruments
from rigd_sim.mechanism.laws import law_numbers
from rigd_sim.mechanism.network import Element, Kind, Mechanism, Warm
from rigd_sim.mechanism.steps import steps_of

#: The sections whose names are those of elements.
SECTIONS = ("springs", "friction", "stops", "pendulums", "drives")


class MechanismDescription(Description):
    """A mechanism."""

    @model_validator(mode="after")
    def _it_is_a_mechanism(self) -> Self:
        """Assemble it.

        Raises:
            WrongEntries: no mechanism is like that; every reason with its entry.
        """
        _ = self.mechanism
        return self

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism, with all units read."""
        return assembled(self)


def assembled(given: Description) -> Mechanism:
    """Return the mechanism of a description.

    Raises:
        WrongEntries: there is none; every reason with its entry.
    """
    notes = Notes()
    _names_differ(given, notes)
    bodies = moving(given, notes)
    builder = _Builder(given, bodies, notes)
    elements = builder.elements()
    notes.raise_any()
    index = {item.name: number for number, item in enumerate(elements)}
    warm = _warm(given, index, notes)
    notes.raise_any()
    mechanism = Mechanism(
        masses=tuple(bodies.masses),
        speeds=tuple(bodies.speeds),
        axes=bodies.axes,
        elements=tuple(elements),
        warm=warm,
        instruments=(),
        gravity=given.gravity,
        ambient=given.ambient,
        parts=steps_of(given, bodies, elements, notes),
        index=index,
    )
    mechanism = replace(mechanism, instruments=instruments(given, mechanism, notes))
    notes.raise_any()
    return mechanism


def _names_differ(given: Description, notes: Notes) -> None:
    seen: dict[str, str] = {}
    for section in SECTIONS:
        for name in getattr(given, section):
            if name in seen:
                notes.add(
                    (section, name),
                    f"{name!r} is the name of one of the {seen[name]} too; give each its own",
                )
            seen[name] = section


class _Builder:
    """Makes the elements of a description."""

    def __init__(self, given: Description, bodies: Moving, notes: Notes) -> None:
        self.given, self.bodies, self.notes = given, bodies, notes

    def elements(self) -> list[Element]:
        """Return all elements, those that can press others first."""
        given = self.given
        found: list[Element] = []
        for make, names in (
            (self._spring, given.springs),
            (self._gravity, given.bodies),
            (self._pendulum, given.pendulums),
            (self._stop, given.stops),
            (self._friction, given.friction),
        ):
            for name in names:
                try:
                    element = make(name)
                except Wrong:
                    continue
                found += [] if element is None else [element]
        for name in given.drives:
            try:
                found.append(drive(name, given, self.bodies, tuple(found), self.notes))
            except Wrong:
                continue
        return found

    def _spring(self, name: str) -> Element:
        """Return a spring with damper, from its entry; numbers in SI."""
        item: Spring = self.given.springs[name]
        path, notes = ("springs", name), self.notes
        along = between_two(path, item.between, item.radius, self.bodies, notes)
        force, unit = along.force_unit, along.unit
        stiffness = notes.amount((*path, "stiffness"), item.stiffness, along.force_per(), high=1e10)
        damping = notes.amount((*path, "damping"), item.damping, along.force_per("s"), high=1e8)
        if stiffness == 0.0 and damping == 0.0:
            raise notes.refuse(path, f"{name} has neither stiffness nor damping: it does nothing")
        play = notes.amount((*path, "play"), item.play, unit, high=1e3)
        preload = notes.signed((*path, "preload"), item.preload, force)
        if preload != 0.0 and (play != 0.0 or stiffness == 0.0):
            raise notes.refuse((*path, "preload"), "only a spring without play has a preload")
        numbers = {"k": stiffness, "d": damping, "play": 0.5 * play}
        offset = preload / stiffness if preload else 0.0
        return _element(name, Kind.SPRING, along, numbers, offset=offset, at_start=preload)

    def _gravity(self, name: str) -> Element | None:
        """Return the weight of a body along its slope, in N; None if it has none."""
        body = self.given.bodies[name]
        if body.slope == 0.0 or not body.mass:
            return None
        along = of_body((), name, self.bodies, self.notes)
        weight = body.mass * self.given.gravity * math.sin(body.slope)
        return _element(f"{name}.weight", Kind.CONSTANT, along, {"k": weight}, at_start=weight)

    def _pendulum(self, name: str) -> Element:
        """Return the torque of gravity on a mass at an arm on a shaft."""
        item, path = self.given.pendulums[name], ("pendulums", name)
        along = of_body((*path, "body"), item.body, self.bodies, self.notes)
        axis = self.bodies.axes[item.body]
        if not axis.turns:
            raise self.notes.refuse(
                (*path, "body"), f"{item.body} moves along a line; a pendulum needs a shaft"
            )
        torque = item.mass * self.given.gravity * item.arm
        return _element(
            name, Kind.PENDULUM, along, {"k": torque}, offset=axis.start,
            at_start=torque * math.sin(axis.start),
        )  # fmt: skip

    def _stop(self, name: str) -> Element:
        """Return the buffers at both ends of the range of a body."""
        item, path, notes = self.given.stops[name], ("stops", name), self.notes
        along = of_body((*path, "body"), item.body, self.bodies, notes)
        axis, unit = self.bodies.axes[item.body], along.unit
        low = notes.signed((*path, "low"), item.low, unit)
        high = notes.signed((*path, "high"), item.high, unit)
        if not low <= axis.start <= high:
            raise notes.refuse(
                path, f"{item.body} starts at {axis.start:g} {unit}, not between its stops "
                f"at {low:g} and {high:g} {unit}",
            )  # fmt: skip
        numbers = {
            "low": low,
            "high": high,
            "k": notes.amount(
                (*path, "stiffness"), item.stiffness, along.force_per(), high=1e10, above=True
            ),
            "d": notes.amount((*path, "damping"), item.damping, along.force_per("s"), high=1e8),
        }
        return _element(name, Kind.STOP, along, numbers, offset=axis.start)

    def _friction(self, name: str) -> Element:
        item, path, notes = self.given.friction[name], ("friction", name), self.notes
        along = between_two(path, item.between, item.radius, self.bodies, notes)
        load, most, unit = self._load(name, item)
        loaded = load is not None
        if loaded and along.force_unit != "N":
            raise notes.refuse(
                path, f"{name} has a normal force: give the 'radius' at which it acts on the shaft"
            )
        kind, numbers = law_numbers(
            (*path, "law"), item.law, "1" if loaded else along.force_unit, along.unit, notes
        )
        return replace(
            _element(name, kind, along, numbers),
            load=1.0 if load is None else load,
            pressed_by=item.pressed_by or "",
            most_load=most,
            load_unit=unit,
        )

    def _load(self, name: str, item: Friction) -> tuple[float | None, float, str]:
        """Return the load in N, the most that can be put on, and the unit of that."""
        path, notes = ("friction", name), self.notes
        if item.pressed_by is not None:
            if item.load is not None or item.most_load is not None:
                raise notes.refuse((*path, "load"), "give 'load' or 'pressed_by', not both")
            notes.known((*path, "pressed_by"), item.pressed_by, self.given.springs, "spring")
            spring = self._spring(item.pressed_by)
            if spring.force_unit != "N":
                raise notes.refuse(
                    (*path, "pressed_by"), f"{item.pressed_by} has a torque, which presses nothing"
                )
            if spring.at_start > 0.0:
                raise notes.refuse(
                    ("springs", item.pressed_by, "preload"),
                    f"{spring.at_start:g} N pulls, and the compression of {item.pressed_by} "
                    f"presses {name}, which would have no friction: write '-{spring.at_start:g} N'",
                )
            return max(0.0, -spring.at_start), 0.0, "N"
        if item.load is None:
            if item.most_load is not None:
                raise notes.refuse((*path, "most_load"), "there is no 'load' that can be changed")
            return None, 0.0, "N"
        load, _, unit = notes.force((*path, "load"), item.load, self.given.gravity)
        if item.most_load is None:
            return load, 0.0, unit
        most, number, same = notes.force((*path, "most_load"), item.most_load, self.given.gravity)
        if same != unit or most < load or most == 0.0:
            raise notes.refuse(
                (*path, "most_load"), f"must be at least 'load', {item.load}, in the same unit"
            )
        return load, number, unit


def _element(
    name: str, kind: Kind, along: Strain, numbers: dict[str, float], *,
    offset: float = 0.0, at_start: float = 0.0,
) -> Element:  # fmt: skip
    """Return an element on the displacement ``along``; ``at_start`` is its force, in SI."""
    return Element(
        name=name, kind=kind, ends=tuple(along.ends), numbers=numbers,
        force_unit=along.force_unit, strain_unit=along.unit, radius=along.radius,
        offset=offset, at_start=at_start,
    )  # fmt: skip


def _warm(given: Description, index: dict[str, int], notes: Notes) -> tuple[Warm, ...]:
    """Return the temperatures, each with the numbers of the frictions that heat it."""
    found = []
    for name, item in given.temperatures.items():
        for place, friction in enumerate(item.heated_by):
            try:
                notes.known(
                    ("temperatures", name, "heated_by", place), friction, given.friction, "friction"
                )
            except Wrong:
                continue
        if all(friction in given.friction for friction in item.heated_by):
            found.append(
                Warm(
                    name,
                    tuple(index[friction] for friction in item.heated_by),
                    item.share * item.resistance,
                    1.0 / (item.capacity * item.resistance),
                )
            )
    return tuple(found)
