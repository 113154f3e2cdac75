"""Reads an observer in the cycle, as if a device measured its states, from the rows of others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigd.model.channels import Channel
from rigd.sdk import Declaration, Driver, DriverConfig

if TYPE_CHECKING:  # a rig file is checked without numba
    from rigd.observers.runner import Runner

#: Name in recordings and lists, in place of that of a driver.
OBSERVER: Final = "observer"
#: Bit of the status word, by its name in conditions: the filter has diverged in this cycle.
STATUS_BITS: Final = {"diverged": 1 << 30}


class ObserverConfig(DriverConfig):
    """An observer of a rig; made by rigd from `observers`, never written in a file."""

    plan: Any
    """What the filter computes: an :class:`~rigd.observers.model.ObserverPlan`."""
    channels: tuple[Channel, ...]
    """Each state and its standard deviation, the innovations, and the NIS."""
    inputs: tuple[str, ...]
    """Channels or setpoints (`device.setpoint_setpoint`) that drive the model."""
    measured: tuple[str, ...]
    """Channels that correct the states."""
    period_ns: int
    """Time of a cycle."""
    lost_ns: int
    """How long nothing may be measured, or an input not be known, before the states are NaN."""
    each_trial: bool
    """Whether the filter begins anew with every trial."""
    texts: tuple[tuple[Path, str], ...] = ()
    """Path and text of the files that its options name."""

    def files(self) -> Mapping[Path, str]:
        """Return path and text of the files that its options name."""
        return dict(self.texts)

    @property
    def devices(self) -> frozenset[str]:
        """The devices from which the observer is computed."""
        return frozenset(name.partition(".")[0] for name in (*self.inputs, *self.measured))


class Observer(Driver[ObserverConfig, Any]):
    """An observer in the cycle. It moves nothing: there is nothing to make safe."""

    title = "states estimated from other channels"
    Config = ObserverConfig

    def __init__(self, config: ObserverConfig, link: Any = None) -> None:
        super().__init__(config, link)
        from rigd.observers.runner import Runner  # it loads numba

        #: Computes its row in each cycle.
        self.runner: Runner = Runner(config)
        #: The newest row as a ring has it; the memory stays the same.
        self.packed = self.runner.packed

    @classmethod
    def declare(cls, config: ObserverConfig) -> Declaration:
        """Return the channels of the observer; a state is of its cycle, however it was found."""
        return Declaration(
            channels=config.channels,
            plain_rows=True,
            has_status=True,
            status_bits=STATUS_BITS,
            every_cycle=False,
        )

    def begin_trial(self) -> None:
        """Begin anew if the rig file asks for it."""
        if self.config.each_trial:
            self.runner.begin()

    def open(self) -> None:
        """Do nothing: there is no device."""

    def arm(self) -> None:
        """Do nothing: it only computes."""

    def read(self, t_ns: int) -> None:
        """Do nothing: the cycle takes the rows of all observers when they are computed.

        Bit 31 of their status: a channel is late.
        """

    def make_safe(self) -> None:
        """Do nothing: it only computes."""
