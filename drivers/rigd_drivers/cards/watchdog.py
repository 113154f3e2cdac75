"""Describes the watchdog of a card in a rig file, and sees it act before a drive is armed.

The watchdog is a retriggerable one-shot beside the card, or a timer in the card. Either way a
digital input of the card shows whether it is up, that is, lets the drives be enabled.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated, Final, Literal, Protocol

from annotated_types import Ge, Le

from rigd.sdk import DeviceError, Documented, In

#: The watchdog is fed this often within its time while it is being raised.
_FEEDS_PER_TIME: Final = 5
#: It has come up after so many of its times, after so many s, and at so many looks, or never will.
_RISE_TIMES: Final = 4
_LEAST_RISE_S: Final = 0.5
_LEAST_LOOKS: Final = 5
#: For so long are looks awaited that come within its time, in s: this machine may stall.
_LONGEST_RISE_S: Final = 10.0


class OneShotOptions(Documented):
    """A retriggerable one-shot that gates the enable lines of the drives on this card."""

    output: Annotated[int, Ge(0)]
    """Digital output that retriggers it, toggled at the end of every cycle."""
    time: Annotated[float, In("s"), Ge(0.001), Le(1)]
    """Longest time it stays up after the last edge, with the tolerance of its parts."""
    input: Annotated[int, Ge(0)]
    """Digital input wired to its output, by which it is proven and watched."""
    active: Literal["high", "low"] = "high"
    """Level of that input while it is up."""


def prove(
    feed: Callable[[], None],
    is_up: Callable[[], bool],
    time_s: float,
    *,
    rises: str,
    falls: str,
    name: str = "the one-shot",
    fed: str = "it is fed",
) -> float:
    """Raise the watchdog, stop feeding it, and return after how many s it dropped.

    A stall of this machine makes the returned time longer, but never the verdict wrong: the
    watchdog fails only if it was seen up later than its time.

    Args:
        feed: feeds it once.
        is_up: looks at it now.
        time_s: longest time that it stays up.
        rises: what to check if it never comes up.
        falls: what to check if it does not drop.
        name: what it is called.
        fed: how it is fed.

    Raises:
        DeviceError: it never came up, or has not dropped in time.
    """
    fed_s = _raise(feed, is_up, time_s, f"{name} does not come up when {fed}", rises)
    while True:
        looked_s = time.monotonic()
        up = is_up()
        seen_s = time.monotonic()
        if not up:
            return seen_s - fed_s
        if looked_s - fed_s > time_s:
            raise DeviceError(
                f"{name} was still up {looked_s - fed_s:.3f} s after its last edge; "
                f"expected at most {time_s:g} s",
                hint=f"nothing would stop the drives if this computer failed; {falls}",
            )


def prove_one_shot(
    one_shot: OneShotOptions | None, feed: Callable[[], None], is_up: Callable[[], bool]
) -> float:
    """Prove the one-shot of a card that may have a watchdog of its own, too; see :func:`prove`.

    Raises:
        DeviceError: there is none, it never came up, or it has not dropped in time.
    """
    if one_shot is None:
        raise DeviceError(
            "neither a one-shot nor a watchdog is declared on this card",
            hint="add 'one_shot' or 'watchdog' to the options of the link, or a waiver to the "
            "device",
        )
    wires = wires_of(one_shot)
    return prove(
        feed, is_up, one_shot.time,
        fed=f"digital output {one_shot.output} toggles",
        rises=f"check its wires to {wires}, and whether it is really '{one_shot.active}' while it "
        "is up",
        falls=f"check its resistor and capacitor, and its wires to {wires}",
    )  # fmt: skip


class Wired(Protocol):
    """A one-shot or watchdog, by the output that raises it and the input that shows it."""

    output: int
    input: int


def wires_of(guard: Wired) -> str:
    """Return the output and the input of a one-shot or watchdog, in words."""
    return f"digital output {guard.output} and digital input {guard.input}"


def _raise(
    feed: Callable[[], None], is_up: Callable[[], bool], time_s: float, problem: str, hint: str
) -> float:
    """Feed it until it is up; return when it was fed last, in s.

    A look that comes later than its time says nothing: it may have dropped again.
    """
    began_s, looks, looked_after_s = time.monotonic(), 0, 0.0
    while True:
        feed()
        fed_s = time.monotonic()
        time.sleep(time_s / _FEEDS_PER_TIME)
        if is_up():
            return fed_s
        seen_s = time.monotonic()
        looked_after_s = seen_s - fed_s
        looks += looked_after_s <= time_s
        rising_s = seen_s - began_s
        if looks >= _LEAST_LOOKS and rising_s > max(_RISE_TIMES * time_s, _LEAST_RISE_S):
            raise DeviceError(problem, hint=hint)
        if rising_s > _LONGEST_RISE_S:
            raise DeviceError(
                f"{problem}; a look at it comes {looked_after_s:.3f} s after its last edge, and it "
                f"stays up for {time_s:g} s only",
                hint=f"this computer or the card is too slow for that time; {hint}",
            )
