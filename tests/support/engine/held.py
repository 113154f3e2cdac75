"""A bank of controllers without a rig: tables, limiter and plant stand in the test."""

from __future__ import annotations

import math
from collections.abc import Collection

from rigd.computed.controllers.bank import Bank
from rigd.computed.controllers.driver import ControllerConfig
from rigd.engine.cycle.limiter import Limiter
from rigd.model.limits import SetpointLimit
from rigd.model.tables import Tables

PERIOD_NS = 1_000_000
OUTPUT = SetpointLimit(-2.0, 2.0, 100.0)
TARGET = SetpointLimit(-50.0, 50.0, math.inf)


def config(name: str = "hold", **options: object) -> ControllerConfig:
    """Return a controller of a force by a current, with ``options``."""
    given: dict[str, object] = {
        "name": name, "measured": "load.force", "unit": "N", "output": "press.current",
        "output_unit": "A", "needs": frozenset(), "low": -2.0, "high": 2.0,
    }  # fmt: skip
    return ControllerConfig.model_validate(given | options)


class Held:
    """The tables of a cycle: ``values`` of load.force, forward and schedule, and their times.

    ``limits`` are those of press.current, then of each controller.
    """

    def __init__(self, *configs: ControllerConfig, limits: tuple[SetpointLimit, ...] = ()) -> None:
        names = ["press.current", *(item.setpoint for item in configs)]
        given = limits or (OUTPUT, *(TARGET for _ in configs))
        self.bank = Bank(configs, dict(zip(names, given, strict=True)), PERIOD_NS * 1e-9)
        self.places = {name: place for place, name in enumerate(names)}
        inputs = ("load.force", "some.forward", "some.schedule", "load.speed")
        readings = {name: place for place, name in enumerate(inputs)}
        self.limiter = Limiter(given, PERIOD_NS * 1e-9, range(1, len(given)))
        self.values = [0.0, 0.0, 1.0, 0.0]
        self.t_ns = 1_790_000_000_000_000_000
        self.stamps = [self.t_ns] * 4
        self.wanted = [limit.rest for limit in given]
        self.rest = list(self.wanted)
        self.tables = Tables(
            self.values, self.stamps, self.limiter.applied, self.wanted, readings, range(4),
            [0] * 4, self.places,
        )  # fmt: skip
        self.bank.bind(self.tables)

    def step(
        self, active: Collection[str] = ("hold.force",), *, fresh: bool = True, **wanted: float
    ) -> str:
        """Play a cycle with the setpoints ``wanted`` (by controller); return why one gives up."""
        self.t_ns += PERIOD_NS
        if fresh:
            self.stamps[:] = [self.t_ns] * 4
        for name, value in wanted.items():
            (place,) = (p for known, p in self.places.items() if known.startswith(f"{name}."))
            self.wanted[place] = value
        self.tables.take(self.t_ns)
        reason = self.bank.step(self.t_ns, active)
        if reason:
            self.wanted[:] = self.rest
        self.limiter.apply(self.wanted)
        return reason

    @property
    def current(self) -> float:
        """What is written to the device."""
        return self.limiter.applied[0]
