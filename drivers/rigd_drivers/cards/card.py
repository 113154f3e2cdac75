"""Defines the interface between a data acquisition card and the drivers that use the card.

The interface carries volts, encoder counts and digital lines.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from rigd.sdk import Link, LinkError


@dataclass(frozen=True)
class Train:
    """Pulses that a counter has timed since it was opened; the first may be wrong."""

    pulses: int = 0
    #: Sum of their periods, each from one rising edge to the next, in s.
    periods_s: float = 0.0
    #: Sum of the times for which the signal was high, in s; 0 if these are not timed.
    high_s: float = 0.0


class Card(Link):
    """A card with analogue inputs and outputs, encoder counters and digital lines.

    Drivers declare in ``open`` what they use; from then on :meth:`begin` takes it all in at one
    moment, and :meth:`end` puts out together what they have set. What has been taken in stands in
    ``volts``, ``counts``, ``indexes`` and ``lines``.
    """

    kind: ClassVar[str] = "card"
    rescued_whole: ClassVar[bool] = True
    #: Volts that the converter gives at its rails; at them the input may be anything beyond.
    lowest_volts: ClassVar[float]
    highest_volts: ClassVar[float]

    #: The card as it names itself, once open.
    identity: str
    #: Analogue inputs in V, by input; NaN if not used.
    volts: list[float]
    #: Encoder counters as they stand in the card (unsigned, ``count_bits`` wide), by encoder.
    counts: list[int]
    count_bits: ClassVar[int]
    #: What the counters of :meth:`use_pulses` have timed, by counter.
    trains: dict[int, Train]
    #: Index signals of the encoders, one bit each.
    indexes: int
    #: Digital inputs, one bit each.
    lines: int
    #: When taking in began, CLOCK_MONOTONIC in ns.
    sampled_ns: int
    #: Longest time that the external one-shot stays up without :meth:`end`, in s; None: no such.
    one_shot_s: float | None
    #: Whether the one-shot was up when the lines were taken in; True if there is none.
    one_shot_up: bool

    @abstractmethod
    def use_inputs(
        self, *, analog: Iterable[int] = (), encoders: Iterable[int] = (), lines: Iterable[int] = ()
    ) -> None:
        """Take these in from now on; encoders and digital inputs may be shared.

        Raises:
            LinkError: the card has no such input, or the analogue one is taken.

        """

    def use_pulses(self, counter: int, *, longest_s: float, width: bool) -> None:
        """Time the pulses at the input of a counter from now on; the counter is the caller's own.

        Args:
            counter: of the card.
            longest_s: longest period to be timed, in s.
            width: also how long each pulse is high.

        Raises:
            LinkError: the card times no pulses, has no such counter, or it is taken.

        """
        raise LinkError(
            f"counter {counter} cannot time pulses: {self.title} only counts them",
            hint="on a card that counts edges use `card-pulses`: `derivative(NAME)` is their rate",
        )

    @abstractmethod
    def take_outputs(self, *, analog: Iterable[int] = (), lines: Iterable[int] = ()) -> None:
        """Make these outputs the caller's own.

        Raises:
            LinkError: the card has no such output, or it is taken.

        """

    @abstractmethod
    def rests_high(self, line: int) -> bool:
        """Return whether a digital output is high at rest."""

    def output_span(self, output: int) -> tuple[float, float]:
        """Return the lowest and the highest volts that an analogue output can give.

        Raises:
            LinkError: the card has no such output.

        """
        return -10.0, 10.0

    @abstractmethod
    def set_volts(self, output: int, volts: float) -> None:
        """Set an analogue output, clipped to what it can give, put out with the rest."""

    @abstractmethod
    def set_line(self, line: int, *, high: bool) -> None:
        """Set a digital output, put out with the rest."""

    @abstractmethod
    def sample(self) -> None:
        """Take in all that is used now, outside of a cycle.

        Raises:
            LinkError: the card does not answer.

        """

    @abstractmethod
    def put_out(self) -> None:
        """Put out what has been set now, outside of a cycle; does not retrigger the one-shot.

        Silent on a card that is not open: its outputs are at rest.

        Raises:
            LinkError: the card does not answer.

        """

    @abstractmethod
    def confirm_outputs(self) -> None:
        """Wait until what was put out has reached the card.

        Silent on a card that is not open.

        Raises:
            LinkError: the card does not answer.

        """

    @abstractmethod
    def prove_one_shot(self) -> float:
        """Raise the one-shot, stop retriggering it, and return after how many s it dropped.

        Raises:
            DeviceError: it never came up, or has not dropped in time.

        """

    @abstractmethod
    def rescue(self) -> None:
        """Bring every output to rest over a connection of its own; for a card not yet open.

        Raises:
            LinkError: the card cannot be reached.

        """


def taken_twice(what: str, number: int) -> LinkError:
    """Return the error for an input or output of a card that has an owner already."""
    return LinkError(
        f"{what} {number} is used twice: by two devices, or by one and the link",
        hint="correct one of the numbers in the rig file",
    )
