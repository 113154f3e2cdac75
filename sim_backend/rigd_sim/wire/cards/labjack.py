"""Serves a simulated LabJack T7 over Modbus TCP, with a bench wired to it."""

from __future__ import annotations

from typing import Any, ClassVar

from rigd_sim.wire.cards.labjack_registers import LabjackRegisters
from rigd_sim.wire.cards.ni_io import Bench
from rigd_sim.wire.modbus.bank import Bank
from rigd_sim.wire.modbus.line import Line
from rigd_sim.wire.modbus.part import LINE_FAULTS, ModbusPart, Ticker
from rigd_sim.wire.part import State

#: The device is brought to now this often, so that its watchdog acts when nobody asks, in s.
_TICK_S = 0.005
#: TCP connections that a T7 or T4 keeps at once (T-Series Datasheet, "Ethernet").
CONNECTIONS = 2
_FAULTS = {
    "watchdog_dead": "the watchdog never acts",
    "watchdog_acts": "the watchdog acts, now",
    "other_product": "the device is a T8",
    "no_tick": "the LJTick-DAC does not answer; its outputs keep their volts",
    "failed_input": "the analogue inputs read -9999 V, as after a failed conversion",
    "counter_reset": "all counters start from zero again, once",
}


class _Registers(Bank):
    """Hands every request to the registers of the device, which know function 76, too."""

    def __init__(self, registers: LabjackRegisters) -> None:
        super().__init__()
        self._registers = registers

    def answer(self, pdu: bytes) -> bytes:
        """See :class:`Bank`."""
        return self._registers.answer(pdu)


class SimLabjack(ModbusPart):
    """One T7 on a TCP port, with its bench.

    Args:
        name: the part.
        line: where it is reached.
        registers: of the device.
        bench: what is wired to them.
    """

    faults: ClassVar[dict[str, str]] = {**LINE_FAULTS, **_FAULTS}

    def __init__(self, name: str, line: Line, registers: LabjackRegisters, bench: Bench) -> None:
        super().__init__(name, line, 1, _Registers(registers))
        self.faults = {**self.faults, **bench.faults}  # type: ignore[misc] # depends on the bench
        self.registers = registers
        self._bench = bench
        self._ticker = Ticker(_TICK_S, registers.advance)

    async def start(self) -> str:
        """See :class:`Part`."""
        served = await super().start()
        self._ticker.start()
        return served

    async def stop(self) -> None:
        """See :class:`Part`."""
        self._ticker.stop()
        await super().stop()

    def state(self) -> State:
        """Return what the outputs of the device show, and what the bench does."""
        registers, watchdog = self.registers, self.registers.watchdog
        registers.advance()
        return {
            "asked": self.asked,
            "watchdog_running": watchdog.running,
            "watchdog_acted": watchdog.acted,
            "watchdog_written": watchdog.written,
            "lines": registers.driven,
            **registers.volts,
            **self._bench.state(),
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the line, of the device, or of what is wired to it."""
        if fault in self._bench.faults:
            self._bench.inject(fault, **options)
        else:
            super().inject(fault, **options)

    def show(self, fault: str) -> bool:
        """See :class:`ModbusPart`."""
        registers = self.registers
        match fault:
            case "watchdog_dead":
                registers.watchdog.dead = True
            case "watchdog_acts":
                registers.watchdog.expire()
            case "other_product":
                registers.product = 8.0
            case "no_tick":
                registers.has_tick = False
            case "failed_input":
                registers.input_failed = True
            case "counter_reset":
                registers.reset_counters()
            case _:
                return False
        return True

    def cleared(self, fault: str | None) -> None:
        """See :class:`ModbusPart`."""
        registers = self.registers
        if fault in (None, "watchdog_dead"):
            registers.watchdog.dead = False
        if fault in (None, "other_product"):
            registers.product = 7.0
        if fault in (None, "no_tick"):
            registers.has_tick = True
        if fault in (None, "failed_input"):
            registers.input_failed = False
        self._bench.clear(fault)
