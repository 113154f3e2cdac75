"""Defines what a driver measures and takes with given options, before any device is constructed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigd.model.channels import STATUS_FIELD, Channel
from rigd.sdk.row import Row


@dataclass(frozen=True)
class Input:
    """A quantity of the rig that a fast driver takes in every cycle.

    ``channel`` is a channel of a device, observer or controller or a derived one, or a setpoint as
    it is recorded (``device.setpoint_setpoint``); ``unit`` is one of its kind, as the value is
    always in SI. ``path`` leads from the options of the device to the entry that names it.
    """

    channel: str
    unit: str
    path: tuple[str | int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """The result of ``declare(config)`` of a driver; made from the options alone.

    Raises:
        ValueError: the fields of ``row`` are not the channels.
    """

    #: The channels that are measured, in the order of a row.
    channels: tuple[Channel, ...] = ()
    #: The rows of a fast or a slow driver: a field for each channel, then ``status`` if there is
    #: one. None for a block driver, a driver without channels, and with ``plain_rows``.
    row: type[Row] | None = None
    #: Rows are sequences of numbers in the order of ``channels``. For channels that are listed in
    #: the options, as the inputs of a card are.
    plain_rows: bool = False
    #: Whether a row ends in an integer status word; taken from ``row``, if given. Bit 31 is rigd's
    #: own: the row is stale.
    has_status: bool = False
    #: Bits of the status word, as masks by name: ``{"stable": 1}``. Procedures wait for them
    #: (``scale is stable``); a reading that is not `stable` is not compared with an answer.
    status_bits: Mapping[str, int] = field(default_factory=dict)
    #: What a fast or a slow driver takes, in the order of ``write``; ``low`` and ``high`` are the
    #: device's.
    setpoints: tuple[Channel, ...] = ()
    #: What a fast driver takes of the rest of the rig in every cycle, as ``take_inputs`` gets it.
    inputs: tuple[Input, ...] = ()
    #: What a person may ask of the device, by name, and what that does: ``{"tare": "sets zero"}``.
    actions: Mapping[str, str] = field(default_factory=dict)
    #: Whether a fast driver has a row in every cycle: a cycle without is recorded as a stale row.
    #: For a device with a pace of its own it is False, and only its new rows are recorded.
    every_cycle: bool = True
    #: The device has failed once it has given no row for so long, in s. A slow device needs more.
    silent_s: float = 0.1
    #: The device is safe at most so long after its driver fell silent, in s, by a watchdog of its
    #: own; None if it has none. A device that takes setpoints cannot be armed without one, unless
    #: the rig file holds a waiver.
    watchdog_s: float | None = None
    #: Rows per second of a block driver, at most; 0 if it is known only from the opened device.
    rate_hz: float = 0.0
    #: How old the newest row of a block driver becomes before the next block comes, in s, while
    #: there is no fault. A rig file whose interlock counts rows as stale sooner is refused.
    oldest_s: float = 0.0

    def __post_init__(self) -> None:
        if self.row is None:
            return
        fields = self.row.fields
        ends_in_status = fields[-1:] == (STATUS_FIELD,)
        if self.has_status and not ends_in_status:
            raise ValueError(f"has_status is set, and {self.row.__name__} has no field 'status'")
        object.__setattr__(self, "has_status", ends_in_status)
        measured = fields[:-1] if ends_in_status else fields
        channels = tuple(channel.name for channel in self.channels)
        if measured != channels:
            raise ValueError(
                f"{self.row.__name__} has the fields {', '.join(measured) or 'none'}; "
                f"the channels are {', '.join(channels) or 'none'}"
            )
