"""Defines the options of a relay on a digital line of an NI card."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from annotated_types import Ge, Le
from pydantic import Field, model_validator

from rigd.sdk import DriverConfig, In, wrong_entry
from rigd_drivers.cards.ni_card import NiCardConfig

LineName = Annotated[str, Field(pattern=r"^port\d+/line\d+$")]
Level = Literal["high", "low"]


class WatchdogOptions(DriverConfig):
    """A retriggerable one-shot beside the card, its contact in series with the relay's coil."""

    line: LineName
    """Output that triggers it; every edge does, or every second one."""
    feedback: LineName
    """Input that shows whether it is up."""
    time: Annotated[float, In("s"), Ge(0.05), Le(1)]
    """Longest time that it stays up after the last edge, its tolerance included."""
    active: Level = "high"
    """Level of `feedback` while it is up. An open line of a USB-6009 reads high: if the
    contact shows its state by closing, `low` also finds a broken wire."""


class NiRelayConfig(NiCardConfig):
    """Which line closes the relay, and what opens the relay if this computer fails."""

    line: LineName = "port0/line0"
    """Output that the relay hangs on."""
    active: Level = "low"
    """Level that closes the relay. The lines of a USB-6009 are pulled up until they are driven, so
    that a relay closed by a high line would close as soon as the card gets its power."""
    watchdog: WatchdogOptions | None = None
    """The one-shot in series with the relay. The card itself keeps its outputs when this computer
    dies; without a one-shot the relay can be armed with a waiver only."""

    @model_validator(mode="after")
    def _lines_are_distinct(self) -> Self:
        if self.watchdog is None:
            return self
        lines = (self.line, self.watchdog.line, self.watchdog.feedback)
        for place, key in ((1, "line"), (2, "feedback")):
            if lines[place] in lines[:place]:
                text = f"{lines[place]} is named twice"
                raise wrong_entry(
                    f"{text}; relay, `line` and `feedback` have one each", "watchdog", key
                )
        return self
