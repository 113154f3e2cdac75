"""Controls a speed servo drive over Modbus, for slow axes: up to 100 setpoints per second."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, ClassVar, Final, Self

from annotated_types import Gt, Le
from pydantic import model_validator

from rigd.sdk import (
    Channel,
    Declaration,
    DeviceError,
    DriverConfig,
    In,
    LinkError,
    ProtocolError,
    Row,
    accepted,
    wrong_entry,
)
from rigd_drivers.device_file import FromFile
from rigd_drivers.modbus.client import TRYING_S, Client
from rigd_drivers.modbus.connection import ConnectionConfig
from rigd_drivers.modbus.device import ModbusDevice, silent_s
from rigd_drivers.modbus.exchange import Answer, Failure
from rigd_drivers.modbus.pdu import Request
from rigd_drivers.modbus.registers import Condition, all_hold
from rigd_drivers.modbus.servo_map import ServoMap, Step
from rigd_drivers.wait import looks

#: Bits of the status word: the drive follows its setpoint; its watchdog has acted, which before
#: arming is no fault (rigd was busy with other devices, and nothing moved).
ENABLED: Final = 1
TRIPPED: Final = 2
#: Making safe may take so many answers of the device: to a request under way, and to two tries. At
#: least and at most, in s, for all writes together; the cycle gives all of its devices 2 s.
_SAFE_ANSWERS: Final = 3
SAFE_S: Final = 0.1
_SAFE_MOST_S: Final = 0.8
#: How long a new connection may take, in s.
_RESCUE_OPEN_S: Final = 0.2
#: After it was disabled, a drive shows that within this time, in s.
_CONFIRM_S: Final = 0.3
#: What makes a connection of no use: it is lost, out of step, or refused on it.
_LOST: Final = (LinkError, ProtocolError, DeviceError)
#: Time from one look at the drive that is being reset to the next, in s.
_LOOK_S: Final = 2e-3
#: The watchdog must outlive so many lost replies in a row, or noise would stop the drive.
_LOST_REPLIES: Final = 2


class ServoConfig(ConnectionConfig):
    """The connection of the drive, its register map, and its largest speed."""

    map: Annotated[ServoMap, FromFile("modbus-servo")]
    """Name of a shipped map (delta-asda-b, schneider-atv320), a
    file of your own beside the rig file, such as my_device.yaml, or a map written here."""
    max_speed: Annotated[float, In("rad/s"), Gt(0)]
    """Largest speed of the motor, of either sign."""
    travel: Annotated[float, In("m/rad")] | None = None
    """Travel per angle of the motor, for an axis in m/s; negative if it runs in the other
    direction.
    """
    watchdog: Annotated[float, In("s"), Gt(0)]
    """The drive stops by itself when it has received nothing for so long."""
    rate: Annotated[float, In("Hz"), Gt(0), Le(100)] = 50.0
    """Setpoints and rows per second asked for; as fast as the line allows, if that is less."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.travel == 0:
            raise wrong_entry("'travel' must not be zero", "travel")
        try:
            self.map.setpoint.encode(self.max_speed / self.map.scale, self.map.word_order)
        except ValueError as error:
            raise wrong_entry(str(error), "max_speed") from error
        counts = self.watchdog / self.map.watchdog.scale
        if round(counts) < 1 or abs(counts - round(counts)) > 1e-6:
            raise wrong_entry(
                f"'watchdog' of {self.watchdog:g} s must be a multiple of "
                f"{self.map.watchdog.scale:g} s, as the drive counts it",
                "watchdog",
            )
        self.map.watchdog.time.encode(counts, self.map.word_order)
        least = 1 / self.rate + _LOST_REPLIES * self.lost_reply_s()
        if self.watchdog < least:
            raise wrong_entry(
                f"'watchdog' of {self.watchdog:g} s is too short for this line: two lost replies "
                f"in a row take {least:g} s; shorten 'timeout' and 'longest_reply', or raise it",
                "watchdog",
            )
        return self


class SpeedRow(Row):
    """Speed, the number in its register, and the status bits of :class:`ModbusServo`."""

    speed: float
    speed_raw: float
    status: int


class ModbusServo(ModbusDevice[ServoConfig]):
    """A speed drive with a communication watchdog, which rigd sets, reads back and tests.

    Safe means without torque, by what the map writes to disable it. Status bits: enabled 1,
    tripped while no request came 2, and the line's (see :class:`ModbusDevice`).
    """

    Config: ClassVar[type[DriverConfig]] = ServoConfig
    title: ClassVar[str] = "speed servo drive, Modbus TCP or RTU"
    #: A TCP drive takes another connection; a serial port is free once its process is dead.
    second_link = True

    def __init__(self, config: ServoConfig, link: None) -> None:
        super().__init__(config, link, config.map, config.rate)
        self._map = config.map
        self._reads = config.map.reads(config.map.polled())
        self._all_reads = config.map.reads([*config.map.polled(), *config.map.watchdog.spans()])
        self._asked = self._reads  # those of the row under way
        self._scale = config.map.scale * (config.travel or 1.0)  # channel's unit per count
        self._words: dict[int, int] = {}
        self._plan: deque[Request] = deque()  # what is left to ask for this row
        self._steps: deque[Step] = deque()  # what is left to write to enable the drive
        self._until: Condition | None = None
        self._hold_until_ns = 0  # what was written last to reset it stands until then
        self._heeded_anew = False  # it was made safe over another connection than the open one
        self._armed = self._enabled = False
        self._at_rest = False  # the drive holds speed zero
        self._faulted = False  # it was in the last row
        self._setpoint = 0.0
        self._unfit: list[str] = []
        self._has_watchdog = False  # it is set, and read back

    @classmethod
    def declare(cls, config: ServoConfig) -> Declaration:
        """Return the speed of the motor, or of the axis that ``travel`` makes of it."""
        unit = "rad/s" if config.travel is None else "m/s"
        limit = config.max_speed * abs(config.travel or 1.0)
        what = "speed of the motor" if config.travel is None else "speed of the axis"
        return Declaration(
            channels=(
                Channel("speed", unit, what, -1.5 * limit, 1.5 * limit),
                Channel("speed_raw", "count", "number in the register", raw_of="speed"),
            ),
            row=SpeedRow,
            setpoints=(Channel("speed", unit, what, -limit, limit),),
            every_cycle=False,
            silent_s=silent_s(config, config.rate),
            watchdog_s=config.watchdog + config.map.watchdog.reaction,
        )

    @property
    def watchdog_s(self) -> float | None:
        """As declared; None while the drive has not kept it."""
        return self.declaration.watchdog_s if self._has_watchdog else None

    def prove(self) -> None:
        """Check the drive's settings, leave a fault of before, set the watchdog.

        :meth:`preflight` reports a watchdog that cannot be set.

        Raises:
            DeviceError: the drive has a fault that does not go away.

        """
        self._plan.clear()
        self.check(self._map.expect)
        for request in self._map.writes(self._map.disable):
            self.client.ask(request)
        if self._in_fault():
            self._reset()
        self._unfit = [*self._set_up(), *self._set_watchdog()]
        self.identity = f"{self._map.title}, map {self._map.standing}"

    def preflight(self) -> Sequence[str]:
        """See :class:`~rigd.sdk.AnyDriver`: a setting or a watchdog that the drive did not keep."""
        return self._unfit

    def prove_watchdog(self) -> float:
        """Fall silent once; return the seconds of silence after which the drive had tripped.

        Raises:
            DeviceError: it did not trip within ``watchdog_s``, or cannot be reset.

        """
        if self.watchdog_s is None:
            raise DeviceError(f"{self.client.where}: the drive has no watchdog to prove")
        self._plan.clear()
        if self._in_fault():
            self._reset()  # it has tripped since it was opened: that proves nothing
        began_ns = time.monotonic_ns()
        time.sleep(self.watchdog_s)  # the silence is the proof
        silent_s = (time.monotonic_ns() - began_ns) * 1e-9
        if not all_hold(self._map.watchdog.tripped, self.fetch(self._all_reads)):
            raise DeviceError(
                f"{self.client.where}: the drive received nothing for {silent_s:.2f} s and did not "
                f"trip; its watchdog is set to {self.config.watchdog:g} s",
                hint="check the drive's reaction to a communication fault, and that it is not "
                "monitored only while it runs",
            )
        self._reset()
        return silent_s

    def arm(self) -> None:
        """Begin to enable the drive, at speed zero; continues in the cycles until :meth:`ready`.

        A drive whose watchdog has acted meanwhile is reset first.
        """
        self._setpoint = 0.0
        self._armed, self._at_rest = True, False
        self._until, self._hold_until_ns = None, 0
        resets = [Step(address=w.address, value=w.value) for w in self._map.reset]
        self._steps = deque([*(resets if self._faulted else ()), *self._map.enable])

    def ready(self) -> bool:
        """Return whether the drive reports that it follows its setpoint."""
        return self._armed and not self._steps and self._enabled

    def write(self, setpoints: Sequence[float]) -> None:
        """Take the speed, clipped to its range; the newest is sent with the next row.

        Raises:
            DeviceError: it is NaN; the one before it holds.

        """
        self._setpoint = accepted(self.declaration.setpoints[0], setpoints[0])

    def read(self, t_ns: int) -> SpeedRow | None:
        """Return speed, counts and status once all of a row has come, else None.

        Raises:
            LinkError: the connection is lost.
            DeviceError: the drive reports a fault, dropped out of operation, or refuses.

        """
        answer = self.take()
        row = None if answer is None else self._took(answer)
        if self.client.free():
            self._ask()
        return row

    def make_safe(self) -> None:
        """Disable the drive: no torque; over a new connection if the open one is of no use.

        Takes 0.1 s, or three times the device's longest answer; twice that and 0.2 s with a new
        connection.

        Raises:
            LinkError: it did not acknowledge; the message has what its watchdog does.

        """
        self._armed = self._enabled = self._heeded_anew = False
        self._steps.clear()
        self._plan.clear()
        if self._client is None:
            return
        try:
            self._disable(self._client)
        except _LOST as error:
            self._client.close()  # a device may take one connection only
            self._disable_anew(error)
            self._heeded_anew = True

    def _disable_anew(self, first: LinkError | ProtocolError | DeviceError) -> None:
        try:
            with self._anew() as client:
                self._disable(client)
        except _LOST as error:
            acts = "it has no watchdog"
            if self.watchdog_s is not None:
                acts = f"its watchdog takes its torque away within {self.watchdog_s:g} s of silence"
            raise LinkError(
                f"{first.message}; over a new connection: {error.message}; {acts}",
                hint=error.hint or first.hint,
            ) from error

    def rescue(self) -> None:
        """Disable over a new connection, and check that the drive obeys.

        Raises:
            LinkError, ProtocolError: it cannot be reached, or does not answer.
            DeviceError: it is still enabled, or refuses.
        """
        with self._anew() as client:
            self._disable(client)
            self._check_disabled(client)

    def confirm_safe(self) -> None:
        """Check that the drive no longer reports that it is enabled: it acts once per scan.

        Raises:
            DeviceError: it is still enabled, or refuses to be read.
            LinkError, ProtocolError: it does not answer.

        """
        if self._heeded_anew:
            with self._anew() as client:
                self._check_disabled(client)
        elif self._client is not None:
            self._check_disabled(self._client)

    @contextmanager
    def _anew(self) -> Iterator[Client]:
        """Open a new connection, and close it in the end."""
        client = self.config.client(self._map.silence)
        client.open(_RESCUE_OPEN_S, again=True)
        try:
            yield client
        finally:
            client.close()

    def _check_disabled(self, client: Client) -> None:
        reads = self._map.reads([range(c.address, c.address + 1) for c in self._map.enabled])
        words: dict[int, int] = {}
        for _ in looks(_CONFIRM_S):
            for read in reads:
                within_s = max(TRYING_S, client.longest_s(read.request))
                words |= read.words(client.ask(read.request, within_s))
            if not all_hold(self._map.enabled, words):
                return
            time.sleep(_LOOK_S)
        raise DeviceError(
            f"{client.where}: the drive took the command to disable, and still reports that it is "
            "enabled",
            hint="cut its supply; then look whether it is commanded over Modbus alone",
        )

    def _disable(self, client: Client) -> None:
        writes = self._map.writes(self._map.disable)
        for request in writes:
            within_s = max(_SAFE_ANSWERS * client.longest_s(request), SAFE_S / len(writes))
            client.insist(request, min(within_s, _SAFE_MOST_S / len(writes)))

    def failed(self, failure: Failure) -> None:
        """Send again when it is due: with the newest setpoint, or the same step."""
        self._plan.clear()

    def _ask(self) -> None:
        """Send the next request of a row begun, or of a new one when it is time."""
        if not self._plan:
            if not self.due():
                return
            self._asked = self._all_reads if self._faulted else self._reads
            command = self._command()
            self._plan.extend([] if command is None else [command])
            self._plan.extend(read.request for read in self._asked)
        self.client.start(self._plan[0])

    def _command(self) -> Request | None:
        """Return what is to be written before the next row is read."""
        if not self._armed:
            return None
        if self._steps and self._at_rest:
            if self._must_stand():
                return None
            return self._map.write(self._steps[0].address, (self._steps[0].value,))
        speed = 0.0 if self._steps else self._setpoint
        words = self._map.setpoint.encode(speed / self._scale, self._map.word_order)
        return self._map.write(self._map.setpoint.address, words)

    def _must_stand(self) -> bool:
        """Return whether the drive has not acted yet on the step that was written last."""
        if self._until is not None:
            return not self._until.holds(self._words)
        return self._faulted and self._holding()

    def _holding(self) -> bool:
        """Return whether a write that resets the drive has just been made."""
        return time.monotonic_ns() < self._hold_until_ns

    def _took(self, answer: Answer) -> SpeedRow | None:
        if not self._plan or answer.request is not self._plan[0]:
            return None  # of a row that was given up
        left = len(self._plan)
        self._plan.popleft()
        if left > len(self._asked):
            self._written()
            return None
        self._words |= self._asked[-left].words(answer.words)
        return None if self._plan else self._row()

    def _written(self) -> None:
        """Note that the drive took the setpoint, or a step on the way to enabling it."""
        if self._steps and self._at_rest:
            hold_ns = time.monotonic_ns() + round(self._map.hold * 1e9)
            self._hold_until_ns = hold_ns if self._resetting() else 0
            self._until = self._steps.popleft().until
        self._at_rest = True

    def _row(self) -> SpeedRow | None:
        known = self._asked is self._all_reads
        self._faulted = all_hold(self._map.fault, self._words)
        if self._faulted and not self._may_be_faulted():
            raise self._fault()
        if self._faulted and not known:
            return None  # the next row shows whether it was its watchdog
        tripped = self._faulted and all_hold(self._map.watchdog.tripped, self._words)
        if self._faulted and not tripped:
            raise self._fault()
        enabled = all_hold(self._map.enabled, self._words)
        if self.ready() and not enabled:
            raise DeviceError(
                f"{self.client.where}: the drive is no longer enabled, and reports no fault",
                hint="check its enable and safe-torque-off inputs",
            )
        self._enabled = enabled
        count = self._map.speed.decode(self._words, self._map.word_order)
        flags = (ENABLED if enabled else 0) | (TRIPPED if tripped else 0)
        status = flags | self.client.status()
        return SpeedRow.of(speed=count * self._scale, speed_raw=count, status=status)

    def _may_be_faulted(self) -> bool:
        """Return whether it is not armed yet, or is being reset."""
        return not self._armed or self._resetting() or self._holding()

    def _resetting(self) -> bool:
        """Return whether the next step is one of those that reset it."""
        return len(self._steps) > len(self._map.enable)

    def _fault(self) -> DeviceError:
        at = {condition.address for condition in self._map.fault}
        words = ", ".join(f"register {a} is {self._words[a]:#06x}" for a in sorted(at))
        return DeviceError(
            f"{self.client.where}: the drive reports a fault ({words})",
            hint="read its display; a communication fault means that it received nothing for "
            f"{self.config.watchdog:g} s",
        )

    def _reset(self) -> None:
        """Leave the fault state.

        Raises:
            DeviceError: the drive stays in it.

        """
        for request in self._map.writes(self._map.reset):
            self.client.ask(request)
            end_ns = time.monotonic_ns() + round(self._map.hold * 1e9)
            while self._in_fault() and time.monotonic_ns() < end_ns:
                time.sleep(_LOOK_S)  # the drive acts on the write when it looks at it
        if self._in_fault():
            raise self._fault()

    def _in_fault(self) -> bool:
        self._words = self.fetch(self._reads)
        return all_hold(self._map.fault, self._words)

    def _set_up(self) -> Sequence[str]:
        """Write the settings that differ; return those not kept, a sentence each."""
        unfit = []
        for each in self._map.setup:
            if each.keeps and self.fetch_word(each.address) == each.value:
                continue  # some drives store what is written, and their memory wears out
            self.client.ask(self._map.write(each.address, (each.value,)))
            if each.keeps and (word := self.fetch_word(each.address)) != each.value:
                unfit.append(f"register {each.address} reads {word} after {each.value} was written")
        return unfit

    def _set_watchdog(self) -> Sequence[str]:
        """Write the watchdog's time and read it back; return what is wrong with it, if anything."""
        watchdog, order = self._map.watchdog, self._map.word_order
        register, counts = watchdog.time, self.config.watchdog / watchdog.scale
        self._has_watchdog = False
        self.client.ask(self._map.write(register.address, register.encode(counts, order)))
        kept = register.decode(self.fetch(self._map.reads([register.addresses])), order)
        if kept != round(counts):
            return [
                f"its watchdog was set to {self.config.watchdog:g} s and reads back as "
                f"{kept * watchdog.scale:g} s: it would not stop when rigd falls silent"
            ]
        self._has_watchdog = True
        return []
