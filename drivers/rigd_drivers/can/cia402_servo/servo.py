"""Provides the base class of drivers for CiA 402 drives.

The class sets up the drive and its watchdog, enables the drive, supervises it and makes it safe.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import ClassVar, Final

from rigd.sdk import Channel, DeviceError, Driver, LinkConfig, LinkError, Row, about_entry
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import cia402, objects, pdo
from rigd_drivers.can.canopen.cia402 import DriveState
from rigd_drivers.can.canopen.counter import Unwrap
from rigd_drivers.can.canopen.inbox import Inbox
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.cia402_servo import by_sdo, plan
from rigd_drivers.can.cia402_servo.config import ServoConfigT
from rigd_drivers.can.cia402_servo.homing import Homing
from rigd_drivers.can.cia402_servo.profile import Choice
from rigd_drivers.can.node import Node
from rigd_drivers.can.pdo import configure, switch_off_rest
from rigd_drivers.can.sheet import Plan, contradictions, refuse
from rigd_drivers.wait import looks

#: Low word of 1000h.
_PROFILE: Final = 402
#: A drive is enabled within this in the cycle (brake, charging of its power stage), in ns.
_ARMING_NS: Final = 3_000_000_000
#: A drive whose PDOs are heeded shows that it is off within this, in s.
_SHOWN_S: Final = 0.03
#: Before this part of its time a watchdog has not acted.
_EARLY: Final = 0.5
#: What to do about a drive that is enabled without bit 12.
_NO_BIT: Final = (
    "the maker's tool may control it; if its manual gives this bit another meaning, or none, in "
    "cyclic modes, write `follows_bit: false`"
)


class Servo(Driver[ServoConfigT, CanBus]):
    """A drive on a CAN bus.

    Safe means *switched off*: target zero and voltage disabled (controlword 0), so that the motor
    has no torque. Nothing then holds the axis but what is spring-applied.
    """

    link_kind = "can"
    second_link = True
    reads_when_safe = True  # SYNC and heartbeat; the controlword stays 0
    #: The option that bounds the setpoint.
    range_option: ClassVar[str]

    def __init__(self, config: ServoConfigT, link: CanBus) -> None:
        super().__init__(config, link)
        self._sign = -1 if config.inverted else 1
        self._choice = self._choose(config)
        self._command = plan.command(config, self._choice)
        self._tpdos = plan.feedback(config, self._feedback(config))
        self._command_layout = self._command.layout()
        self._inboxes: tuple[Inbox, ...] = ()
        self._span = by_sdo.WHOLE_POSITION
        self._unwrap = Unwrap(self._span)
        self._zero = 0.0
        self._enabling = cia402.Enabling()
        self._homing = Homing()
        self._armed = False
        self._enabled = False
        self._armed_ns = 0
        self._off = False  #: was seen off, and without a fault, since it was armed
        self._node: Node | None = None
        self._set_up = False

    # -- before the first cycle ----------------------------------------------------------------

    @classmethod
    def contradictions(cls, config: ServoConfigT, link: LinkConfig | None) -> Sequence[str]:
        """Return what in the EDS contradicts this drive on ``link``."""
        optional = [(objects.ABORT_CONNECTION_OPTION, by_sdo.DISABLE_VOLTAGE_OPTION)]
        writes, pdos = cls._writes(config, link), cls._pdos(config)
        planned = Plan(_PROFILE, plan.reads(config), writes, pdos, optional)
        beyond = cls._beyond_range(config, cls._declared_target(config))
        return [*contradictions(config, link, planned), *beyond, *plan.too_short(config, link)]

    def reserve(self) -> None:
        """See :class:`AnyDriver`: the node id is this device's alone."""
        with about_entry("node"):
            self.link.claim(self.config.node, self.title)

    def open(self) -> None:
        """Set the drive up by SDO, reading everything back, and leave it switched off.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it is another device, or refuses the set-up.
            DeviceError: it has a fault that cannot be reset.
        """
        self.close()
        refuse(self.title, self.contradictions(self.config, self.link.config))
        node = self._node = Node(self.link, self.config.node, self.config.sheet())
        node.open(self.title, _PROFILE, self.config.serial)
        profile = self.config.profile
        if profile is not None:
            profile.confirm(node)
            by_sdo.switch_off(node)
            profile.prepare(node)
        scaling = self._check_ratings(node)
        known = [node.identity, scaling, self._profiled()]
        self.identity = ", ".join(each for each in known if each)
        refuse(node, self._beyond_range(self.config, self._largest_target()))
        by_sdo.watch_heartbeat(node, self.config.watchdog)
        by_sdo.switch_off(node)
        node.ensure(self._choice.target, 0)
        by_sdo.set_mode(node, self._choice.mode)
        self._map(node)
        self._span = by_sdo.position_span(node)
        self._unwrap = Unwrap(self._span)
        count = self._unwrap.begin(node.read(objects.POSITION))
        self._zero = count if self.config.zero is None else self.config.zero
        self._armed = self._enabled = False
        self._inboxes = tuple(
            Inbox(tpdo, self.config.node, self.link.syncs) for tpdo in self._tpdos
        )
        for item, inbox in zip(self._tpdos, self._inboxes, strict=True):
            self.link.subscribe(item.identifier, inbox.receive)
        command = self._command
        self.link.reserve_identifier(
            command.identifier, f"sends {command}, the setpoints of node {self.config.node}"
        )
        self.link.on_resume(self.config.node, self._resume)
        node.start()
        self._set_up = True

    def prove_watchdog(self) -> float:
        """Enable at zero target, withhold the heartbeat, and time the drive's switching off.

        Returns s from the last heartbeat until the drive gave no torque. It is
        enabled by SDO, so that neither RPDO nor SYNC runs meanwhile.

        Raises:
            DeviceError: it cannot be enabled, stayed enabled for ``watchdog_s``, or lost its
                torque for another reason, before half of the watchdog's time.

        """
        node = self._opened()
        limit_s = self.watchdog_s or 0.0
        try:
            took_s = self._fall_silent(node, limit_s)
            if took_s > limit_s:
                took_s = self._fall_silent(node, limit_s)  # this host may have stalled: once more
        except BaseException:
            self.make_safe()  # on any error; it is not left enabled
            raise
        if took_s > limit_s:
            raise DeviceError(
                f"{node} did not switch itself off within {limit_s:.3f} s of the last heartbeat, "
                f"twice; measured: {took_s:.3f} s",
                hint="its heartbeat consumer (object 1016) or abort connection option (6007) has "
                "no effect: update its firmware; do not run without",
            )
        return took_s

    # -- the cycle -----------------------------------------------------------------------------

    def arm(self) -> None:
        """Begin to enable the drive at zero target, resetting a fault that our silence made."""
        self._homing.end()
        self._enabling = cia402.Enabling()
        self._enabled = self._off = False
        self._armed = True
        self._armed_ns = time.monotonic_ns()

    def ready(self) -> bool:
        """Return whether the drive is enabled and follows the target."""
        return self._enabled

    def read(self, t_ns: int) -> Row | None:
        """Return the row that answers the SYNC of the cycle before, or None if none came.

        Raises:
            DeviceError: an emergency, a fault, a restart, or the drive left operation enabled.
            ProtocolError: a frame has not the length mapped, or comes twice each SYNC.

        """
        self._opened().watch(forgive_silence=not self._enabled)
        syncs = self.link.syncs
        values: list[int] = []
        complete = not self.link.behind
        for inbox in self._inboxes:
            part = inbox.take(syncs)
            if part is None:
                complete = False
            else:
                values += part
        if not complete:
            self._check_arming()
            return None
        self._homing.shown = values[0]
        self._follow_state()
        return self._row(values)

    def act(self, action: str) -> None:
        """Begin to set the position where the drive stands to 0.

        Raises:
            DeviceError: it is armed, or that is in progress.
            LinkError: it is not open.
            ValueError: unknown action.

        """
        method, node = self.config.homing_method, self._opened()
        if action != "home" or method is None:
            raise ValueError(f"{self.title} has no action {action!r}")
        if self._armed:
            raise DeviceError(f"{node} is armed", hint="home it at rest, before a run")
        self._homing.begin(node, method, self._choice.mode, self._span)

    def acted(self) -> str | None:
        """Return what the drive shows once it is homed, None before; see :meth:`Homing.advance`."""
        told = self._homing.advance()
        if told is not None:
            self._unwrap = Unwrap(self._span)  # the step in its position is no movement
            self._zero = self.config.zero or 0.0
        return told

    def make_safe(self) -> None:
        """Switch the drive off: target zero and voltage disabled, twice, each with a SYNC.

        Does nothing if the bus is not open: the drive's watchdog then has acted, or the drive was
        never enabled.

        Raises:
            LinkError: the bus takes no frames; the watchdog switches the drive off.
        """
        self._armed = self._enabled = False
        self._homing.end()
        if not self._reachable():
            return
        for _ in range(2):
            self._flush_safe()

    def confirm_safe(self) -> None:
        """Check that the drive gives no torque; switch it off by SDO if its PDOs do not show it.

        Raises:
            LinkError: it does not answer; the watchdog switches it off.
            ProtocolError, DeviceError: it refuses, or is still enabled.

        """
        node = self._node
        if node is None or not self._set_up or not self._reachable():
            return
        self.link.alone = False
        try:
            if not self._shows_off():
                by_sdo.force_off(self.link, self.config.node)
        except LinkError as error:
            raise LinkError(
                f"{error.message}; its watchdog takes its torque away within "
                f"{self.watchdog_s:g} s of the last heartbeat",
                hint=error.hint,
            ) from error
        finally:
            self.link.alone = True
            node.attach()

    def rescue(self) -> None:
        """Switch the drive off over a new connection, and check that it is off.

        Raises:
            LinkError: the bus cannot be opened, or the drive does not answer.
            DeviceError: it is still enabled.
        """
        bus = self.link
        bus.open_second()
        try:
            self.make_safe()
            by_sdo.force_off(bus, self.config.node)
        finally:
            bus.close()

    def close(self) -> None:
        """Leave the drive pre-operational; closing twice is silent."""
        self._set_up = False
        self._homing.end()
        node, self._node = self._node, None
        if node is not None:
            node.close()

    # -- for the modes -------------------------------------------------------------------------

    @abstractmethod
    def _row(self, values: Sequence[int]) -> Row:
        """Return the row of the values of all TPDOs, in the order of ``_feedback``."""

    @classmethod
    @abstractmethod
    def _choose(cls, config: ServoConfigT) -> Choice:
        """Return the mode of operation and its objects."""

    @classmethod
    @abstractmethod
    def _feedback(cls, config: ServoConfigT) -> tuple[tuple[Entry, ...], ...]:
        """Return what the drive sends at every SYNC, one tuple of entries per TPDO."""

    @classmethod
    @abstractmethod
    def _declared_target(cls, config: ServoConfigT) -> int | None:
        """Return the largest target of either sign that ``config`` allows; None: not known yet."""

    @abstractmethod
    def _largest_target(self) -> int:
        """Return the same for the opened drive."""

    @classmethod
    def _beyond_range(cls, config: ServoConfigT, largest: int | None) -> list[str]:
        """Return which limit in the EDS a target up to ``largest`` passes."""
        sheet = config.sheet()
        if sheet is None or largest is None:
            return []
        problems = (
            sheet.beyond(cls._choose(config).target, target) for target in (-largest, largest)
        )
        return [f"{each}, which `{cls.range_option}` allows" for each in problems if each]

    @abstractmethod
    def _check_ratings(self, node: Node) -> str:
        """Find the scaling of the drive's units; return it in words, "" if there is none.

        Raises:
            ProtocolError: drive and rig file contradict each other, or do not suffice.

        """

    def _put_safe_outputs(self) -> None:
        """Queue the safe state of what else the drive switches."""

    def _send_target(self, target: int) -> None:
        """Queue controlword and target of this cycle; the target counts once enabled."""
        if not self._armed:
            word, target = self._homing.word, 0
        elif self._enabled:
            word = cia402.ENABLE
        else:
            word, target = self._enabling.next(self._homing.shown), 0
        self.link.put(self._command.identifier, self._command_layout.pack(word, target))

    @staticmethod
    def accepted(channel: Channel, value: float) -> float:
        """Return ``value`` within the range of ``channel``.

        Raises:
            DeviceError: it is not a number.

        """
        if value != value:
            raise DeviceError(
                f"setpoint '{channel.name}' is NaN; expected "
                f"{channel.low:g} to {channel.high:g} {channel.unit}",
                hint="a profile or a limit computed NaN",
            )
        return min(max(value, channel.low), channel.high)

    # -- within --------------------------------------------------------------------------------

    def _opened(self) -> Node:
        if self._node is None:
            raise LinkError(f"the drive at node {self.config.node} is not open")
        return self._node

    def _flush_safe(self) -> None:
        self.link.put(self._command.identifier, self._command_layout.pack(0, 0))
        self._put_safe_outputs()
        self.link.flush()

    def _shows_off(self) -> bool:
        """Order the safe state again; return whether the drive's PDOs soon show it."""
        inbox = self._inboxes[0]
        for _ in looks(_SHOWN_S):
            before = inbox.came
            self._flush_safe()
            if not self.link.wait(partial(_came_since, inbox, before), by_sdo.LOOK_S):
                continue
            values = inbox.newest()
            if values is not None and cia402.state_of(values[0]) in by_sdo.TORQUELESS:
                return True
        return False

    def _reachable(self) -> bool:
        return self.link.is_open

    def _map(self, node: Node) -> None:
        pdos = self._pdos(self.config)
        for item in pdos:
            configure(node, item)
        switch_off_rest(node, pdos)

    @classmethod
    def _writes(cls, config: ServoConfigT, link: LinkConfig | None) -> list[tuple[Entry, int]]:
        """Return what set-up and proof of the watchdog write by SDO, beside the PDOs."""
        return plan.writes(config, link, cls._choose(config))

    @classmethod
    def _pdos(cls, config: ServoConfigT) -> tuple[pdo.Pdo, ...]:
        command = plan.command(config, cls._choose(config))
        return (command, *plan.feedback(config, cls._feedback(config)))

    def _profiled(self) -> str:
        """Return the profile and the mode that it chose, in words; "" without a profile."""
        profile, mode = self.config.profile, self._choice.mode
        return "" if profile is None else f"{profile} in {mode.title} mode ({mode:d})"

    def _fall_silent(self, node: Node, limit_s: float) -> float:
        """Enable the drive, fall silent, and return when it was off; beyond the limit: not yet.

        Leaves it switched off and operational.

        Raises:
            DeviceError: it lost its torque before its watchdog can have acted.

        """
        with self._beating():
            self.link.beat()
            by_sdo.switch_off(node)  # it may have a fault: our silence for another drive's proof
            if by_sdo.reports_silence(node):
                node.emergency = None  # likewise
            node.write(self._choice.target, 0)
            by_sdo.enable(node)
            self.link.beat()
        began_ns = self.link.beat_ns
        while True:
            off = by_sdo.state(node) in by_sdo.TORQUELESS
            silent_s = (time.monotonic_ns() - began_ns) * 1e-9
            if off or silent_s > limit_s:
                break
            self.link.wait(lambda: node.emergency is not None, by_sdo.LOOK_S)
        if off and silent_s < _EARLY * self.config.watchdog:
            self._check_silence_is_reported(node, silent_s)
        with self._beating():
            self.link.beat()
            by_sdo.switch_off(node)
            node.start()
        return silent_s

    def _check_silence_is_reported(self, node: Node, silent_s: float) -> None:
        """Raise DeviceError unless the emergency of a drive that is off blames our silence.

        The heartbeat consumer acts once its time has run out, and reports 8130h (CiA 301, 1016h).
        """
        self.link.wait(lambda: node.emergency is not None, by_sdo.LOOK_S)
        if by_sdo.reports_silence(node):
            return
        cause = "" if node.emergency is None else f"; {node.emergency}"
        raise DeviceError(
            f"{node} lost its torque {silent_s:.3f} s after the last heartbeat, when its watchdog "
            f"of {self.config.watchdog:g} s cannot have acted yet{cause}",
            hint=by_sdo.NOT_ENABLED,
        )

    @contextmanager
    def _beating(self) -> Iterator[None]:
        self.link.beating = True
        try:
            yield
        finally:
            self.link.beating = False

    def _resume(self) -> None:
        """Make the drive operational again after a pause between two cycles, unless it moves."""
        if self._node is not None and not self._enabled:
            self._node.restart_quietly()

    def _follow_state(self) -> None:
        word = self._homing.shown
        state = cia402.state_of(word)
        if self._enabled:
            if state is not DriveState.ENABLED:
                raise DeviceError(
                    f"{self._node} has left operation enabled: {state.value} "
                    f"(statusword 0x{word:04X})",
                    hint="look at its error history (object 1003)",
                )
            if not self._follows(word) or not word & cia402.REMOTE:
                raise DeviceError(
                    f"{self._node} ignores its target (statusword 0x{word:04X}: bit 12 or 9 is 0)",
                    hint="the maker's tool may control it, or a limit switch",
                )
        elif self._armed:
            in_fault = state in (DriveState.FAULT, DriveState.FAULT_REACTION)
            if in_fault and self._off:
                raise DeviceError(
                    f"{self._node} went to {state.value} while it was being enabled "
                    f"(statusword 0x{word:04X})",
                    hint="look at its error history (object 1003)",
                )
            if state is not DriveState.ENABLED:
                self._off = self._off or not in_fault
            elif self._off:  # else it answers a SYNC from before it was made safe
                self._enabled = self._follows(word)
            self._check_arming()

    def _follows(self, word: int) -> bool:
        given = self.config.follows_bit
        needed = self._choice.follows_bit if given is None else given
        return not needed or bool(word & cia402.FOLLOWS)

    def _check_arming(self) -> None:
        if not self._armed or self._enabled:
            return
        if self.link.now_ns - self._armed_ns > _ARMING_NS:
            word = self._homing.shown
            state = cia402.state_of(word)
            lacks, hint = "", None if word & cia402.VOLTAGE else by_sdo.NOT_ENABLED
            if state is DriveState.ENABLED:
                lacks, hint = ", and bit 12, that it follows its target, is 0", _NO_BIT
            raise DeviceError(
                f"{self._node} is not enabled {_ARMING_NS // 1_000_000_000} s after arming: "
                f"{state.value} (statusword 0x{word:04X}){lacks}",
                hint=hint,
            )


def _came_since(inbox: Inbox, before: int) -> bool:
    """Return whether ``inbox`` has received more than the ``before`` frames it had."""
    return inbox.came > before
