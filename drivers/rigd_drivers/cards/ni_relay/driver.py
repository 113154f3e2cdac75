"""Opens and closes the relay, and retriggers its one-shot as long as the cycle runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import ClassVar, Final

from rigd.sdk import Channel, Declaration, DeviceError, Driver, DriverConfig, LinkError, Row
from rigd_drivers.cards.ni_relay.config import NiRelayConfig, WatchdogOptions
from rigd_drivers.cards.ni_relay.keeper import CYCLE_SILENCE_S, Keeper, Seen
from rigd_drivers.cards.ni_relay.lines import CALL_S, RelayLines
from rigd_drivers.wait import looks

#: Bits of the status word.
ARMED: Final = 1  #: its setpoint is followed
ONE_SHOT: Final = 2  #: the one-shot lets the relay close; set if there is none
PENDING: Final = 4  #: the card has not confirmed the last setpoint yet
LIMITED: Final = 8  #: the last setpoint lay beyond 0 to 1

#: The card gets a request this often, in s; within the time of a one-shot so often at least.
PERIOD_S: Final = 0.05
_PULSES_PER_TIME: Final = 5
#: A confirmation of the card older than this, in s, is no row of this cycle any more.
FRESH_S: Final = 0.15
_LOOK_S: Final = 0.002
#: A thread of ours that stood still as we did has so many looks to hear from the card, 0.2 s.
_LATE_LOOKS: Final = 100


class RelayRow(Row):
    """What the card has confirmed; the status bits above."""

    closed: float
    latency: float
    status: int


class NiRelay(Driver[NiRelayConfig, None]):
    """Closes and opens a relay. Safe means open, and no pulses for the one-shot.

    Commands to the card go through a thread of its own, which takes the newest setpoint, so
    that no cycle waits. A row contains what the card has confirmed last, and how long the
    confirmation of the last change took; the contact follows some ms later, as in the relay's data
    sheet.

    The card keeps its outputs when this computer dies. The one-shot is what opens the relay then:
    its contact stands in series, and it drops within ``time`` of the last pulse. Pulses end with
    this process, and 0.1 s after the last cycle if the cycle hangs.
    """

    Config: ClassVar[type[DriverConfig]] = NiRelayConfig
    title: ClassVar[str] = "relay on a digital line of an NI card"
    second_link: ClassVar[bool] = True

    def __init__(self, config: NiRelayConfig, link: None = None) -> None:
        super().__init__(config, link)
        watchdog = config.watchdog
        self._period_s = PERIOD_S
        if watchdog is not None:
            self._period_s = min(PERIOD_S, watchdog.time / _PULSES_PER_TIME)
        self._lines = RelayLines(config)
        self._keeper: Keeper | None = None
        self._armed_ns = 0  # 0: it is not
        self._up_ns = 0  # when the one-shot was seen up first since it is armed; 0: not yet
        self._limited = False

    @classmethod
    def declare(cls, config: NiRelayConfig) -> Declaration:
        """Return the contact as channel and setpoint, and how long the card takes."""
        watchdog = config.watchdog
        return Declaration(
            channels=(
                Channel(
                    "closed", "1", "whether the relay is closed, as the card confirmed it", 0, 1
                ),
                Channel("latency", "s", "from the last change of the setpoint to its confirmation"),
            ),
            row=RelayRow,
            status_bits={
                "armed": ARMED, "one_shot": ONE_SHOT, "pending": PENDING, "limited": LIMITED,
            },
            setpoints=(Channel("closed", "1", "1 closes the relay, 0 opens it", 0, 1),),
            silent_s=2 * CALL_S,
            watchdog_s=None if watchdog is None else CYCLE_SILENCE_S + watchdog.time,
        )  # fmt: skip

    def open(self) -> None:
        """Take the lines and open the relay.

        Raises:
            LinkError: NI-DAQmx, its server or the card is not there, or another program uses
                the lines.
            ProtocolError: it is another card than the rig file names.
            DeviceError: the card does not have these lines.
        """
        if self._keeper is not None:
            return
        self.identity = f"{self._lines.open()}, relay on {self.config.line}"
        self._keeper = Keeper(self._lines, self._period_s)
        self._keeper.start()

    def prove_watchdog(self) -> float:
        """Retrigger the one-shot, then stop like a dead cycle, and check that it drops.

        The relay stays open. A stall of this machine makes the returned time longer, but never the
        verdict wrong: the one-shot fails only if it was seen up later than its time allows.

        Raises:
            DeviceError: it does not come up, or does not drop in time.
        """
        keeper, watchdog = self._opened(), self.config.watchdog
        if watchdog is None:
            raise DeviceError(
                "no one-shot is declared for this relay",
                hint="add `watchdog` to its options, or a waiver to the device",
            )
        self._await_drop(keeper, watchdog)  # it must be our pulses that raise it
        self._raise_one_shot(keeper, watchdog)
        return self._await_drop(keeper, watchdog)

    def arm(self) -> None:
        """Begin to feed the one-shot; :meth:`ready` once it is up."""
        self._up_ns = 0
        self._armed_ns = time.monotonic_ns()

    def ready(self) -> bool:
        """Return whether the one-shot lets the relay close."""
        return self._up_ns > 0

    def read(self, t_ns: int) -> RelayRow | None:
        """Return what the card has confirmed: closed, latency, status word.

        None without a recent confirmation.

        Raises:
            LinkError: the device server does not answer.
            DeviceError: the card is gone, or the one-shot dropped while the relay was armed.
        """
        keeper = self._opened()
        self._check_talk(keeper)
        known, now_ns = keeper.known, time.monotonic_ns()
        if now_ns - known.at_ns > FRESH_S * 1e9:
            return None
        status = LIMITED if self._limited else 0
        if known.wish != keeper.wish:
            status |= PENDING
        seen = keeper.seen
        up = self._one_shot_up(seen)
        if up:
            status |= ONE_SHOT
        if self._armed_ns:
            status |= ARMED
            self._check_one_shot(seen, up=up)
        return RelayRow.of(closed=float(known.closed), latency=known.latency_s, status=status)

    def write(self, setpoints: Sequence[float]) -> None:
        """Close the relay from 0.5 on, open it below; ignored until it is armed.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.
        """
        value = setpoints[0]
        if value != value:
            raise DeviceError(
                "setpoint 'closed' is NaN; expected 0 or 1",
                hint="a profile or a limit computed NaN; the previous setpoint holds",
            )
        self._limited = not 0.0 <= value <= 1.0
        if self._armed_ns:
            keeper = self._opened()
            keeper.feed()
            keeper.want(closed=value >= 0.5)

    def make_safe(self) -> None:
        """Order the relay to open, and let the one-shot drop; never waits."""
        self._armed_ns = self._up_ns = 0
        if self._keeper is not None:
            self._keeper.starve()
            self._keeper.want(closed=False, at_once=True)

    def confirm_safe(self) -> None:
        """Wait until the card confirms that the relay opens.

        Raises:
            DeviceError, LinkError: it does not; the one-shot opens the relay.
        """
        keeper = self._keeper
        if keeper is None:
            return
        wish = keeper.wish
        for _ in looks(CALL_S, late=_LATE_LOOKS):
            if keeper.known.wish >= wish:
                return
            failed = keeper.failed
            if failed is not None and failed.wish >= wish:
                raise failed.why
            time.sleep(_LOOK_S)
        raise LinkError(
            f"the card did not confirm within {CALL_S:g} s that the relay opens",
            hint="switch the motor's supply off; see that the card can be reached",
        )

    def rescue(self) -> None:
        """Open the relay over a connection of its own; see :class:`Driver`."""
        self._lines.rescue()

    def close(self) -> None:
        """Release the lines, which keep their levels; closing twice is silent."""
        self._armed_ns = self._up_ns = 0  # the next open() arms nothing
        keeper, self._keeper = self._keeper, None
        if keeper is not None:
            keeper.end()
        self._lines.close()

    def _opened(self) -> Keeper:
        if self._keeper is None:
            raise LinkError("the relay is not open", hint="open() comes first")
        return self._keeper

    def _check_talk(self, keeper: Keeper) -> None:
        failed = keeper.failed
        if failed is not None:
            raise failed.why

    def _one_shot_up(self, seen: Seen | None) -> bool:
        """Return whether the one-shot was up when it was looked at last, since it is armed."""
        if self.config.watchdog is None:
            return True
        return seen is not None and seen.up and seen.looked_ns > self._armed_ns

    def _check_one_shot(self, seen: Seen | None, *, up: bool) -> None:
        """Raise if it was down since it came up, however short: the relay opened meanwhile."""
        if not self._up_ns:
            ours = self.config.watchdog is None or (seen and seen.edge_ns > self._armed_ns)
            if up and ours:  # by a pulse of now: by one before it would drop
                self._up_ns = max(self._armed_ns, seen.looked_ns if seen else 0)
        elif self.config.watchdog and seen and seen.down_ns > self._up_ns:
            self._up_ns = 0
            raise DeviceError(
                "the one-shot dropped and opened the relay",
                hint="this computer stalled, see 'rigd doctor'; or its supply or a wire is loose",
            )

    def _await_drop(self, keeper: Keeper, watchdog: WatchdogOptions) -> float:
        """Wait, without a pulse, until the one-shot is down; return how long that took, in s."""
        silent_ns = time.monotonic_ns()
        while True:
            self._check_talk(keeper)
            seen = keeper.seen
            if seen is not None and seen.looked_ns > silent_ns:
                if not seen.up:
                    return (seen.seen_ns - silent_ns) * 1e-9
                up_s = (seen.looked_ns - max(seen.edge_ns, silent_ns)) * 1e-9
                if up_s > watchdog.time:
                    raise DeviceError(
                        f"the one-shot was still up {up_s:.3f} s after its last edge; expected at "
                        f"most {watchdog.time:g} s",
                        hint="nothing would open the relay when this computer dies; check its "
                        f"resistor and capacitor, and the wire to {watchdog.feedback}",
                    )
            time.sleep(_LOOK_S)

    def _raise_one_shot(self, keeper: Keeper, watchdog: WatchdogOptions) -> None:
        """Feed the one-shot until it is up."""
        began_ns = time.monotonic_ns()
        for _ in looks(max(4 * watchdog.time, 1.0), late=_LATE_LOOKS):
            keeper.feed()
            self._check_talk(keeper)
            seen = keeper.seen
            if seen is not None and seen.up and seen.looked_ns > began_ns:
                return
            time.sleep(_LOOK_S)
        raise DeviceError(
            f"the one-shot does not come up when {watchdog.line} toggles",
            hint=f"check the wires to it and from it to {watchdog.feedback}, and whether that is "
            f"really {watchdog.active} while it is up",
        )
