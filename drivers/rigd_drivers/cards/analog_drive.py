"""Provides the base class of drivers for motor drives that are wired to a data acquisition card.

The card gives the set value in volts and switches the enable line. It reads the monitor, a voltage
that shows a quantity such as the current.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Literal, TypeVar

from annotated_types import Ge, Le

from rigd.sdk import (
    Channel,
    DeviceError,
    Driver,
    DriverConfig,
    In,
    LinkError,
    about_entry,
    wrong_entry,
)
from rigd_drivers.cards.card import Card

Level = Literal["high", "low"]


#: Bits of the status word of a drive on a card.
ENABLED: Final = 1  #: its enable line is active
LIMITED: Final = 2  #: the last setpoint lay beyond its range and was clipped
SATURATED: Final = 4  #: the monitor is at a rail of the card
READY: Final = 8  #: its ready output is up; set if none is wired
ONE_SHOT: Final = 16  #: the one-shot lets the enable line through; set if there is none


class AnalogDriveConfig(DriverConfig):
    """How the drive is wired to the card."""

    set_output: Annotated[int, Ge(0)]
    """Analogue output of the card that gives the set value."""
    set_inverted: bool = False
    """Whether a negative voltage asks for a positive value."""
    monitor_input: Annotated[int, Ge(0)]
    """Analogue input of the card that the monitor is wired to."""
    monitor_inverted: bool
    """Whether a positive value gives a negative voltage."""
    monitor_zero: Annotated[float, In("V"), Ge(-5), Le(5)] = 0.0
    """Voltage of the monitor at rest."""
    enable_output: Annotated[int, Ge(0)]
    """Digital output of the card on the enable input of the drive."""
    enable_active: Level = "high"
    """Level of that output that enables the drive; at rest it must have the other."""
    ready_input: Annotated[int, Ge(0)] | None = None
    """Digital input of the card on the ready (no fault) output of the drive."""
    ready_active: Level = "high"
    """Level of that input while the drive is ready."""
    behind_one_shot: bool = False
    """Whether the one-shot of the card gates the enable line. Without it nothing stops the drive
    when this computer dies, and it can be armed with a waiver only."""

    def signed(self, monitor_scale: float) -> float:
        """Return the value per volt of the monitor with its sign."""
        return -monitor_scale if self.monitor_inverted else monitor_scale

    def monitor_channels(self, setpoint: Channel, monitor_scale: float) -> tuple[Channel, Channel]:
        """Return what the monitor gives: the quantity of ``setpoint``, and its volts."""
        scale = self.signed(monitor_scale)
        ends = [(volts - self.monitor_zero) * scale for volts in (-10.0, 10.0)]
        name, doc = setpoint.name, f"{setpoint.doc}, by the monitor"
        return (
            Channel(name, setpoint.unit, doc, min(ends), max(ends)),
            Channel(f"{name}_raw", "V", "monitor at the card", -10, 10, raw_of=name),
        )


AnalogConfigT = TypeVar("AnalogConfigT", bound=AnalogDriveConfig)


class AnalogDrive(Driver[AnalogConfigT, Card]):
    """A drive that takes its set value in volts and shows one monitor in volts.

    Subclasses name the setpoint and the monitored quantity. Safe means 0 V and not enabled, at
    once; the outputs of the card go on driving, since an input left open may drift. Closing the
    card brings them to rest too.
    """

    link_kind: ClassVar[str] = "card"
    second_link: ClassVar[bool] = True

    def __init__(
        self, config: AnalogConfigT, link: Card, *, set_scale: float, monitor_scale: float
    ) -> None:
        super().__init__(config, link)
        self._setpoint = self.declaration.setpoints[0]
        self._volts_per_unit = (-1.0 if config.set_inverted else 1.0) / set_scale
        self._units_per_volt = config.signed(monitor_scale)
        self._owns_outputs = False  # those of another device are never touched
        self._armed = False
        self._enabled = False  # ready, once, since it was armed
        self._limited = False

    @property
    def watchdog_s(self) -> float | None:
        """The one-shot of the card, if it protects the drive."""
        return self.link.one_shot_s if self.config.behind_one_shot else None

    def open(self) -> None:
        """Take the outputs and inputs on the card; the outputs are at rest.

        Raises:
            LinkError: the card does not have them, another device drives them, or the enable line
                would be active at rest.
        """
        self.reserve()
        self._armed = self._enabled = False  # also if it was closed while it was armed
        self._owns_outputs = True
        self.identity = self.link.identity

    def reserve(self) -> None:
        """See :class:`AnyDriver`: the outputs and the monitor are this drive's alone."""
        config, card = self.config, self.link
        with about_entry("enable_output"):
            if card.rests_high(config.enable_output) == (config.enable_active == "high"):
                raise LinkError(
                    f"digital output {config.enable_output} stands {config.enable_active} at "
                    "rest, which enables the drive",
                    hint="correct 'high_at_rest' of the link, or 'enable_active' here",
                )
        with about_entry("behind_one_shot"):
            if config.behind_one_shot and card.one_shot_s is None:
                raise LinkError(
                    "'behind_one_shot' is set, but the card has no 'one_shot'",
                    hint="add 'one_shot' to the options of the link, or remove 'behind_one_shot'",
                )
        with about_entry("set_output"):
            card.take_outputs(analog=(config.set_output,))
        with about_entry("enable_output"):
            card.take_outputs(lines=(config.enable_output,))
        self._check_span()
        with about_entry("monitor_input"):
            card.use_inputs(analog=(config.monitor_input,))
        if config.ready_input is not None:
            with about_entry("ready_input"):
                card.use_inputs(lines=(config.ready_input,))

    def preflight(self) -> Sequence[str]:
        """Return what is wrong with the drive at rest: it reports a fault, or its monitor does."""
        self.link.sample()
        reasons = []
        if not self._reports_ready():
            reasons.append(
                f"the drive is not ready (digital input {self.config.ready_input}): "
                "see its LED, its supply, and 'ready_active'"
            )
        if self._monitor()[2] & SATURATED:
            volts = self.link.volts[self.config.monitor_input]
            reasons.append(
                f"the monitor gives {volts:.2f} V with the drive disabled (analogue input "
                f"{self.config.monitor_input}): check its wire"
            )
        return reasons

    def prove_watchdog(self) -> float:
        """Let the one-shot drop once, and return after how many s it did; see :class:`Driver`.

        The drive stays disabled: what is proven is the one-shot, not its wire to the drive.
        """
        return self.link.prove_one_shot()

    def arm(self) -> None:
        """Set 0 V and enable; :meth:`ready` once the drive reports it."""
        self._enabled = False
        self._armed = True
        self.link.set_volts(self.config.set_output, 0.0)
        self._set_enable(active=True)

    def ready(self) -> bool:
        """Return whether the drive is enabled and reports ready."""
        return self._enabled

    def make_safe(self) -> None:
        """Set 0 V and disable, at once."""
        self._armed = self._enabled = False
        if self._owns_outputs:
            self._rest()
            self.link.put_out()

    def confirm_safe(self) -> None:
        """Check that the card has taken what make_safe put out; no input shows the enable line.

        Raises:
            LinkError: the card does not answer.

        """
        if self._owns_outputs:
            self.link.confirm_outputs()

    def rescue(self) -> None:
        """Bring all outputs of the card to rest, over a connection of its own."""
        self.link.rescue()

    def _check_span(self) -> None:
        """Check that the output of the card can give what every setpoint needs.

        Raises:
            LinkError: it cannot.

        """
        output, wanted = self.config.set_output, self._setpoint
        low, high = self.link.output_span(output)
        ends = sorted(value * self._volts_per_unit for value in (wanted.low, wanted.high))
        if ends[0] < low - 1e-9 or ends[1] > high + 1e-9:
            raise LinkError(
                f"analogue output {output} gives {low:g} to {high:g} V; {wanted.low:g} to "
                f"{wanted.high:g} {wanted.unit} need {ends[0]:g} to {ends[1]:g} V",
                hint="use an output that gives both signs; of a LabJack, one of an LJTick-DAC",
            )

    def _rest(self) -> None:
        self.link.set_volts(self.config.set_output, 0.0)
        self._set_enable(active=False)

    def _set_enable(self, *, active: bool) -> None:
        high = active == (self.config.enable_active == "high")
        self.link.set_line(self.config.enable_output, high=high)

    def _monitor(self) -> tuple[float, float, int]:
        """Return the monitored value, the volts it comes from, and the status word.

        Raises:
            DeviceError: the drive was enabled, and is not any more.

        """
        config, card = self.config, self.link
        volts = card.volts[config.monitor_input]
        status = LIMITED if self._limited else 0
        if volts <= card.lowest_volts or volts >= card.highest_volts:
            status |= SATURATED
        if self._reports_ready():
            status |= READY
        if card.one_shot_up or not config.behind_one_shot:
            status |= ONE_SHOT
        if self._armed:
            status |= ENABLED
            self._check_enabled(status)
        return (volts - config.monitor_zero) * self._units_per_volt, volts, status

    def _reports_ready(self) -> bool:
        line = self.config.ready_input
        if line is None:
            return True
        return bool(self.link.lines >> line & 1) == (self.config.ready_active == "high")

    def _check_enabled(self, status: int) -> None:
        if status & READY and status & ONE_SHOT:
            self._enabled = True
        elif self._enabled and not status & READY:
            raise DeviceError(
                f"the drive is not ready any more (digital input {self.config.ready_input})",
                hint="it reports a fault: over-current, over-temperature or supply; see its LED",
            )
        elif self._enabled:
            raise DeviceError(
                f"the one-shot dropped and disabled the drive: no edge for {self.watchdog_s:g} s",
                hint="this computer stalled; give the one-shot more time, or see 'rigd doctor'",
            )

    def _demand(self, value: float) -> None:
        """Ask for ``value``, in the unit of the setpoint, once the drive is armed.

        Raises:
            DeviceError: it is not a number; the value before it holds.

        """
        clipped = accepted(self._setpoint, value)
        self._limited = clipped != value
        if self._armed:
            self.link.set_volts(self.config.set_output, clipped * self._volts_per_unit)


def accepted(setpoint: Channel, value: float) -> float:
    """Return ``value`` clipped to the range of ``setpoint``.

    Raises:
        DeviceError: it is not a number.

    """
    low, high = setpoint.low, setpoint.high
    if value != value:
        raise DeviceError(
            f"setpoint '{setpoint.name}' is NaN; expected {low:g} to {high:g} {setpoint.unit}",
            hint="a profile or a limit computed NaN; the previous setpoint holds",
        )
    return min(max(value, low), high)


def check_reach(name: str, largest: float, set_scale: float) -> None:
    """Check that ``largest`` can be asked for within +-10 V.

    Raises:
        WrongEntries: it cannot.

    """
    volts = largest / set_scale
    if volts > 10.0:
        raise wrong_entry(
            f"'{name}' needs {volts:g} V at the set value input; a card gives at most 10 V", name
        )
