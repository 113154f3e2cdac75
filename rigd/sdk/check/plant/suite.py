"""Applies all conformance rules to a plant."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from typing import Any, Final

from pydantic import ValidationError

from rigd.sdk.check.plant.bench import Device, PlantSubject
from rigd.sdk.check.plant.physics import RULES
from rigd.sdk.check.plant.rules import CLASS_RULES, CONSTRUCTOR, PLANT_RULES
from rigd.sdk.check.plant.sequences import RULES as SEQUENCES
from rigd.sdk.check.report import NonConforming, Report, examine
from rigd.sdk.plant import Plant

_STAGES: Final = (CLASS_RULES, CONSTRUCTOR, PLANT_RULES, SEQUENCES, RULES)


def check_plant(
    plant_class: type[Plant],
    options: Mapping[str, Any] | None = None,
    *,
    devices: Mapping[str, Device] | None = None,
    truth: str = "",
    accuracy: float = 0.01,
    only: Collection[str] = (),
    seed: int = 1,
    raises: bool = True,
) -> Report:
    """Put a plant to the test; return what was checked.

    Args:
        plant_class: the plant.
        options: its options as a rig file gives them; None for the defaults.
        devices: the simulated devices that stand on it, by name: driver and options. All of their
            setpoints are moved, all of their rows compared. Without them only what needs none is
            checked.
        truth: the name of the device that shows the hidden state, without noise.
        accuracy: share of the energy turned over by which it may fail to balance, and share of
            its range by which half the step may change the truth.
        only: names of the rules to apply, while one is being worked on; by default all.
        seed: the sequences that are drawn at random are drawn from it; the report states it.
        raises: whether a broken rule is an error; :func:`examine_plant` only reports it.

    Raises:
        NonConforming: the plant breaks rules; the message names all, with what to do.
        ValueError: the options are not valid, or there is no such rule or device.

    """
    subject = PlantSubject(plant_class, options or {}, devices or {}, truth, accuracy, seed)
    if truth and truth not in subject.devices:
        raise ValueError(f"no device {truth!r}; there are {', '.join(subject.devices)}")
    try:
        subject.config()
    except ValidationError as error:
        raise ValueError(f"the options given to the suite are not accepted: {error}") from error
    # A plant that cannot be made has nothing else to show.
    report = examine(
        plant_class.__name__,
        _STAGES,
        lambda rule: rule.check(subject),
        lambda rule: rule.missing(subject),
        gates={CONSTRUCTOR[0].name},
        only=only,
        seed=seed,
    )
    if report.findings and raises:
        raise NonConforming(report)
    return report


#: Returns the report of :func:`check_plant`, without raising.
examine_plant: Final = partial(check_plant, raises=False)
