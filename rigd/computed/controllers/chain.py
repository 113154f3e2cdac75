"""Finds which controllers act in a step, from the program alone: before anything moves."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping


def sequence(loops: Mapping[str, str]) -> list[str] | None:
    """Return the setpoints of ``loops``, each before that of the controller that it commands.

    ``loops`` maps the setpoint of each controller to the setpoint that it commands, which may be
    that of another controller. None if they go round in a circle.
    """
    ordered: list[str] = []
    while len(ordered) < len(loops):
        commanded = {loops[name] for name in loops if name not in ordered}
        free = [name for name in loops if name not in ordered and name not in commanded]
        if not free:
            return None
        ordered += free
    return ordered


def acting(
    loops: Mapping[str, str], before: Collection[str], commanded: Collection[str]
) -> frozenset[str]:
    """Return the controllers (by their setpoints) that act in a step that sets ``commanded``.

    ``before`` acted in the step before. A controller begins with a value for its setpoint, and with
    it the controllers that it commands. It ends if the step sets what it commands.
    """
    found = {name for name in loops if name in before or name in commanded}
    for name in list(found):
        chain = list(commands(loops, name))
        if any(item in commanded for item in chain):
            found.discard(name)
    return frozenset(
        {*found, *(item for name in found for item in commands(loops, name) if item in loops)}
    )


def commands(loops: Mapping[str, str], name: str) -> Iterator[str]:
    """Yield what the controller ``name`` commands, and what that commands, to the actuator."""
    while name in loops:
        name = loops[name]
        yield name


def through(loops: Mapping[str, str], steps: Iterable[Collection[str]]) -> Iterator[frozenset[str]]:
    """Yield the controllers that act in each of ``steps``; each step is what it sets."""
    before: frozenset[str] = frozenset()
    for commanded in steps:
        before = acting(loops, before, commanded)
        yield before
