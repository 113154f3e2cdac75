"""Watches what a simulated device does to its actuators, while a driver is called.

The peer shows it (:class:`~rigd.sdk.check.Observed`); nothing here goes over the driver's link.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from rigd.model.channels import Channel
from rigd.sdk.check.cycle_bench import Bench, rest
from rigd.sdk.check.peer import Observed
from rigd.sdk.check.subject import UnfitSubject, described

#: Time between two looks at the device, in s.
LOOK_S: Final = 0.001
#: An actuator that is driven with a value within this part of its range of another has that value:
#: frames and cards carry whole numbers.
NEAR: Final = 0.01
#: An actuator follows its setpoint within this time, in s: drives pass through states.
FOLLOWS_S: Final = 2.0
#: What was sent has arrived after this time, in s; no command of a cycle follows in it.
ARRIVES_S: Final = 0.06


@contextmanager
def watched(found: Bench) -> Iterator[list[Observed]]:
    """Look at the device all the time, and yield the list of all that differs from look to look."""
    seen = [found.look()]
    ended = threading.Event()
    failed: list[Exception] = []

    def watch() -> None:
        while not ended.wait(LOOK_S):
            try:
                now = found.look()
            except Exception as error:  # noqa: BLE001  # of the peer: raised below
                failed.append(error)
                return
            if now != seen[-1]:
                seen.append(now)

    watcher = threading.Thread(target=watch, name="watcher of the device", daemon=True)
    watcher.start()
    try:
        yield seen
    finally:
        ended.set()
        watcher.join()
    seen.append(found.look())
    if failed:
        raise failed[0]


def setpoints_of(found: Bench) -> tuple[Channel, ...]:
    """Return the setpoints of the driver."""
    return found.driver.declaration.setpoints


def far(found: Bench) -> tuple[float, ...]:
    """Return the setpoints at the end of their ranges that is farther from rest."""
    return tuple(
        channel.high if channel.high - at >= at - channel.low else channel.low
        for channel, at in zip(setpoints_of(found), rest(found.driver), strict=True)
    )


def near(found: Bench, driven: Sequence[float], wanted: Sequence[float]) -> bool:
    """Return whether all actuators are driven with what is wanted."""
    return len(driven) == len(wanted) and all(
        abs(value - want) <= NEAR * (channel.high - channel.low)
        for channel, value, want in zip(setpoints_of(found), driven, wanted, strict=True)
    )


def moved(
    found: Bench, seen: Sequence[Observed], *, rested: bool = False
) -> tuple[str, float] | None:
    """Return the name of the first actuator that was not at rest, and what it was driven with.

    At rest it is driven as before the driver was opened, or if ``rested``, with the setpoint zero.
    """
    for look in seen:
        for index, channel in enumerate(setpoints_of(found)):
            at_rest = [found.fresh.driven[index], *([rest(found.driver)[index]] if rested else [])]
            value = look.driven[index]
            room = NEAR * (channel.high - channel.low)
            if not any(abs(value - item) <= room for item in at_rest):
                return channel.name, value
    return None


def shown(found: Bench, driven: Sequence[float]) -> str:
    """Return in words what the actuators are driven with."""
    return ", ".join(
        f"{channel.name} with {value:g} {channel.unit}"
        for channel, value in zip(setpoints_of(found), driven, strict=False)
    )


def until(holds: Callable[[], bool], within_s: float) -> bool:
    """Wait until something holds; return whether it did in time."""
    end = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(LOOK_S)
    return True


def follow(found: Bench, wanted: Sequence[float], within_s: float = FOLLOWS_S) -> bool:
    """Go through cycles with setpoints until the actuators have them; return whether they got them.

    Raises:
        UnfitSubject: a cycle raises.

    """
    end = time.monotonic() + within_s
    while not near(found, found.look().driven, wanted):
        if time.monotonic() > end:
            return False
        outcome = found.cycle(wanted)
        if outcome.error is not None:
            raise UnfitSubject(f"a cycle raises {described(outcome.error)}")
    return True


def run(found: Bench) -> None:
    """Arm the device and drive it, as in the middle of a run.

    Raises:
        UnfitSubject: its actuators do not follow.

    """
    found.arm()
    if setpoints_of(found) and not follow(found, far(found)):
        raise UnfitSubject(
            f"armed and with setpoints at the end of the range, the device drives "
            f"{shown(found, found.look().driven)}"
        )


def listen(found: Bench, for_s: float) -> None:
    """Go through cycles without a setpoint."""
    end = time.monotonic() + for_s
    while time.monotonic() < end:
        found.cycle(())
