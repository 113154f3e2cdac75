"""Defines the driver under test: its class, its options and its simulated devices."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from rigd.model.errors import DeviceError, LinkError, ProtocolError
from rigd.sdk.check.drawn_options import drawn_options
from rigd.sdk.check.peer import Peer
from rigd.sdk.declaration import Declaration
from rigd.sdk.driver import AnyDriver, DriverConfig

#: The errors that a driver may raise if a device or its connection fails.
FAILURES = (LinkError, ProtocolError, DeviceError)


#: So often options are drawn until they fit each other.
DRAWS = 20


class UnfitSubject(Exception):
    """A rule could not be checked because the driver failed before; the message states how."""


@dataclass(frozen=True)
class Subject:
    """The driver to which the rules are applied."""

    driver_class: type[AnyDriver]
    #: As a rig file gives them, or read already.
    options: Mapping[str, Any] | DriverConfig
    peer: Callable[[], AbstractContextManager[Peer]] | None
    #: Whether the peer shows what the device does.
    observes: bool = False
    #: The faults of the peer that it can end.
    faults: Collection[str] = ()
    #: Whether the peer makes devices that differ, and may be there several times; if not, each is
    #: as its author made it.
    varies: bool = False
    #: What is drawn at random is drawn from it.
    seed: int = 1
    #: Options that were drawn, beside those of the author.
    more: Mapping[str, Any] = field(default_factory=dict)
    #: What its devices differ in from others of their make is drawn from it.
    varied: str = ""
    #: What the report says beside the findings: what could not be judged.
    notes: list[str] = field(default_factory=list)

    def drawn(self, rng: random.Random, end: int | None = None) -> Mapping[str, Any]:
        """Return options at random with which the driver can be declared; {} if there are none.

        The first that are tried are at an ``end`` of their ranges, if it is given.
        """
        if isinstance(self.options, DriverConfig):
            return {}
        for turn in range(DRAWS):
            at = None if turn else end
            options = drawn_options(self.driver_class.Config, self.options, rng, at)
            with contextlib.suppress(ValueError):  # they contradict each other
                replace(self, more=options).declare()
                return options
        return {}

    def config(self, more: Mapping[str, Any]) -> DriverConfig:
        """Return the options with ``more`` among them.

        Raises:
            ValidationError: they are not those of the driver.
            ValueError: they are read already, and cannot be added to.

        """
        if not isinstance(self.options, DriverConfig):
            return self.driver_class.Config.model_validate({**self.options, **self.more, **more})
        if more:
            raise ValueError("give the suite the options as a mapping: the peer adds its own")
        return self.options

    def declare(self) -> Declaration:
        """Return the declaration of the driver for the options."""
        return self.driver_class.declare(self.config({}))

    def make(self, peer: Peer, link: object) -> Any:
        """Return a new driver for ``peer``; nothing is opened."""
        return self.driver_class(self.config(peer.options), link)

    @contextmanager
    def fresh_peer(self) -> Iterator[Peer]:
        """Start a simulated device for one rule only."""
        if self.peer is None:
            raise RuntimeError("no peer was given")
        with self.peer() as peer:
            if peer.vary is not None and self.varies:
                peer.vary(random.Random(f"{self.seed} {self.varied}"))
            yield peer


@dataclass(frozen=True)
class NamedRule:
    """A rule; ``demand`` is the sentence that states what it requires."""

    name: str
    demand: str


@dataclass(frozen=True)
class Rule(NamedRule):
    """A rule for drivers.

    ``check`` yields a sentence for every breach. ``fault`` is the fault that the peer must be able
    to show; "" if a healthy peer is enough, None if no peer is needed. ``observes`` is true if the
    peer must show what the device does.
    """

    check: Callable[[Subject], Iterator[str]]
    fault: str | None = None
    observes: bool = False


def described(error: BaseException) -> str:
    """Return an error in the form in which a report names it."""
    return f"{type(error).__name__}: {error}"
