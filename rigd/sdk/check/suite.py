"""Applies all conformance rules to a driver."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import Any, Final

from pydantic import ValidationError

from rigd.sdk.check import declaration_rules, leaks
from rigd.sdk.check.blocks import RULES as BLOCK_RULES
from rigd.sdk.check.cyclic.rules import RULES as CYCLE_RULES
from rigd.sdk.check.opening import RULES as OPENING_RULES
from rigd.sdk.check.peer import FAULTS, Peer
from rigd.sdk.check.report import NonConforming, Report, all_of, examine
from rigd.sdk.check.slow_rules import RULES as SLOW_RULES
from rigd.sdk.check.subject import Rule, Subject
from rigd.sdk.driver import AnyDriver, BlockDriver, Driver, DriverConfig, SlowDriver

#: The rules of each kind of driver that need a device.
RULES: Final[Mapping[type[Any], tuple[Rule, ...]]] = {
    Driver: (*CYCLE_RULES, *OPENING_RULES),
    BlockDriver: (*BLOCK_RULES, *OPENING_RULES),
    SlowDriver: (*SLOW_RULES, *OPENING_RULES),
}
#: So often a rule is applied that is broken: it counts if it is each time.
TIMES: Final = 3
#: Rules that play a sequence which fails again.
PLAYED: Final = frozenset({*BLOCK_RULES, *SLOW_RULES, CYCLE_RULES[0]})
#: Rules that end the examination when they are broken.
GATES: Final = frozenset(
    {
        declaration_rules.DECLARES[0].name,
        declaration_rules.UNOPENED_RULES[0].name,
        *(rules[0].name for rules in RULES.values()),
    }
)


def check_driver(
    driver_class: type[AnyDriver],
    options: Mapping[str, Any] | DriverConfig | None = None,
    *,
    peer: Callable[[], AbstractContextManager[Peer]] | None = None,
    only: Collection[str] = (),
    seed: int = 1,
    raises: bool = True,
) -> Report:
    """Put a driver to the test; return what was checked.

    Args:
        driver_class: the driver, of any kind.
        options: its options as a rig file gives them, or its Config; None for the defaults.
        peer: starts a simulated device, see :class:`Peer`; without one only what needs no
            device is checked. It is started anew for each rule.
        only: names of the rules to apply, while one is being worked on; by default all.
        seed: the calls and the options that are drawn at random are drawn from it. The report
            states it, so that what was found can be played again.
        raises: whether a broken rule is an error; :func:`examine_driver` only reports it.

    Raises:
        NonConforming: the driver breaks rules; the message names all, with what to do.
        ValueError: the options are not valid, the peer has a fault of an unknown name, or there
            is no such rule.

    """
    kind = _kind(driver_class)
    stages = (
        declaration_rules.CLASS_RULES, declaration_rules.DECLARES, declaration_rules.DECLARED_RULES,
        declaration_rules.UNOPENED_RULES[:1], declaration_rules.UNOPENED_RULES[1:],
        RULES[kind][:1], RULES[kind][1:],
    )  # fmt: skip
    subject, faults = _subject(driver_class, {} if options is None else options, peer, seed)
    # A driver that cannot be constructed, or opened, has nothing else to show.
    report = examine(
        driver_class.__name__,
        stages,
        lambda rule: _confirmed(rule, subject),
        lambda rule: _missing(rule, faults, observes=subject.observes),
        gates=GATES,
        only=only,
        seed=seed,
        notes=subject.notes,
    )
    if report.findings:
        leaks.let_go()
        if raises:
            raise NonConforming(report)
    return report


#: Returns the report of :func:`check_driver`, without raising.
examine_driver: Final = partial(check_driver, raises=False)


def _confirmed(rule: Rule, subject: Subject) -> Iterator[str]:
    """Yield the breaches of a rule that come each time: this machine may stall."""
    first = ""
    for _ in range(TIMES):
        if not (problems := all_of(partial(rule.check, subject))):
            if first:
                subject.notes.append(f"{rule.name}: showed not each time: {first}")
            return
        first = first or problems[0]
        if rule.fault is None or rule in PLAYED:  # it is sure, or was played again
            break
    yield from problems


def _missing(rule: Rule, faults: frozenset[str] | None, *, observes: bool) -> str:
    if rule.fault is None:
        return ""
    if faults is None:
        return "no peer was given"
    if rule.fault not in {"", *faults}:
        return f"the peer has no fault {rule.fault!r}"
    return "" if observes or not rule.observes else "the peer does not show what the device does"


def _subject(
    driver_class: type[AnyDriver],
    options: Mapping[str, Any] | DriverConfig,
    peer: Callable[[], AbstractContextManager[Peer]] | None,
    seed: int,
) -> tuple[Subject, frozenset[str] | None]:
    """Return the examined driver and the faults of its peer, None without a peer."""
    subject = Subject(driver_class, options, peer, seed=seed)
    faults: frozenset[str] | None = None
    more: Mapping[str, Any] = {}
    if peer is not None:
        with peer() as first:
            more = first.options
            faults = frozenset(first.faults)
            subject = replace(
                subject,
                observes=first.observed is not None,
                faults=faults.difference(first.lasts) if first.mend is not None else (),
                varies=first.vary is not None,
            )
        if unknown := faults - FAULTS.keys():
            raise ValueError(
                f"the peer has the fault {', '.join(sorted(unknown))}; "
                f"those the suite knows are {', '.join(FAULTS)}"
            )
    try:
        subject.config(more)
    except ValidationError as error:
        raise ValueError(f"the options given to the suite are not accepted: {error}") from error
    if not isinstance(options, DriverConfig):  # the rules without a peer need all options
        subject = replace(subject, options={**options, **more})
    return subject, faults


def _kind(driver_class: type[AnyDriver]) -> type[AnyDriver]:
    for kind in RULES:
        if issubclass(driver_class, kind):
            return kind
    raise TypeError(
        f"{driver_class.__name__} derives from none of Driver, BlockDriver and SlowDriver"
    )
