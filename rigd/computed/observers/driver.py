"""Reads an observer in the cycle, as if a device measured its states, from the rows of others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigd.computed.driver import Computed, ComputedConfig
from rigd.model.channels import Channel
from rigd.sdk import Declaration

if TYPE_CHECKING:  # a rig file is checked without numba
    from rigd.computed.observers.runner import Runner

#: Name in recordings and lists, in place of that of a driver.
OBSERVER: Final = "observer"
#: Bit of the status word, by its name in conditions: the filter has diverged in this cycle.
STATUS_BITS: Final = {"diverged": 1 << 30}


class ObserverConfig(ComputedConfig):
    """An observer of a rig; made by rigd from `observers`."""

    plan: Any
    """What the filter computes: an :class:`~rigd.computed.observers.model.ObserverPlan`."""
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


class Observer(Computed[ObserverConfig, Any]):
    """An observer in the cycle. Bit 31 of its status: a channel is late."""

    title = "states estimated from other channels"
    Config = ObserverConfig

    def __init__(self, config: ObserverConfig, link: Any = None) -> None:
        super().__init__(config, link)
        from rigd.computed.observers.runner import Runner  # it loads numba

        #: Computes its row in each cycle.
        self.runner: Runner = Runner(config)
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
