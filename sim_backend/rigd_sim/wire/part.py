"""Defines the base class of a simulated device that is reached over a real connection."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

#: What a part reports of itself: numbers in SI, words.
State = Mapping[str, float | int | bool | str]


class Part(ABC):
    """One simulated device: a server on the event loop of the simulation.

    The physics come as plain callables given to the constructor, so that a part knows its
    protocol and nothing of the plant.
    """

    #: Name of the rig's device that it stands for.
    name: str
    #: Faults it can show, and what each does, in a line.
    faults: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    async def start(self) -> str:
        """Begin to serve; return a line with its address.

        Raises:
            OSError: the name or port is taken.

        """

    @abstractmethod
    async def stop(self) -> None:
        """Stop serving; stopping twice is silent."""

    @abstractmethod
    def state(self) -> State:
        """Return what an observer at the bench would see of the device."""

    def inject(self, fault: str, **options: Any) -> None:
        """Show ``fault`` from now on, until cleared; some act once.

        Raises:
            ValueError: it has no such fault, or not with these options; names those it has.

        """
        raise ValueError(f"{self.name} has no fault {fault!r}; it knows none")

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
