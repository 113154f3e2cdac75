"""Both drivers before rigd's own conformance suite: one on TCP, one on a serial line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from support.cards.served import served
from support.instruments.modbus_bench import Bench, Physics

from rigd.sdk.check import Observed, Peer, check_driver
from rigd_drivers.modbus.servo import ModbusServo
from rigd_drivers.modbus.transmitter import ModbusTransmitter
from rigd_sim.wire.modbus.line import Line, SerialLine, TcpLine
from rigd_sim.wire.modbus.servo import SimModbusServo
from rigd_sim.wire.modbus.transmitter import LoadCell, SimModbusTransmitter
from rigd_sim.wire.part import Part

TRANSMITTER = {"map": "laumas-tlb4", "scale": "0.01 N/count", "low": "-500 N", "high": "500 N"}
SERVO = {"map": "schneider-atv320", "max_speed": "3000 rpm", "watchdog": "1.5 s"}


def cell(line: Line) -> Part:
    force = LoadCell(lambda: 12.5, capacity=500.0, resolution=0.01, noise=0.05, seed=1)
    return SimModbusTransmitter("cell", line, force)


def drive(line: Line) -> SimModbusServo:
    physics = Physics()
    return SimModbusServo("drive", line, command=physics.command, speed=lambda: physics.speed)


def observed(part: Part) -> Observed:
    """Return what the motor of a drive does; a transmitter has none."""
    state = part.state()
    if not isinstance(part, SimModbusServo):
        return Observed()
    watchdog_s = float(state["watchdog_s"])
    return Observed(
        driven=(float(state["speed"]),),
        energised=bool(state["enabled"]),
        watchdog_s=watchdog_s or None,
        trips=int(state["trips"]),
    )


def own_faults(bench: Bench) -> dict[str, Callable[[], None]]:
    """Return the faults that only a drive can show."""
    if not isinstance(bench.part, SimModbusServo):
        return {}
    return {
        "unguarded": lambda: bench.fault("watchdog_dead"),
        "stuck": lambda: bench.fault("stuck"),
        "locked": lambda: bench.fault("locked"),
    }


def peer_of(
    make: Callable[[Line], Part], kind: str, folder: Path
) -> Callable[[], AbstractContextManager[Peer]]:
    @contextmanager
    def peer() -> Iterator[Peer]:
        line: Line = TcpLine(port=0) if kind == "tcp" else SerialLine(folder / "tty", 115200)
        part = make(line)
        with served(part) as call:
            bench = Bench(line, part, Physics())
            bench.call = call
            damage = "crc" if line.is_serial else "wrong_transaction"
            # A pty hands bytes on in a thread of the kernel, which waits on a loaded machine.
            patience = {"timeout": "0.2 s"} if line.is_serial else {}
            yield Peer(
                options=bench.options(**patience),
                faults={
                    "dead": lambda: bench.fault("cut"),
                    "silent": lambda: bench.fault("silent"),
                    "late": lambda: bench.fault("late", delay_s=1.0),
                    "garbled": lambda: bench.fault(damage),
                    **own_faults(bench),
                },
                observed=lambda: observed(part),
            )

    return peer


def test_the_transmitter_keeps_its_promises(tmp_path: Path) -> None:
    check_driver(ModbusTransmitter, TRANSMITTER, peer=peer_of(cell, "rtu", tmp_path))


def test_the_servo_keeps_its_promises(tmp_path: Path) -> None:
    check_driver(ModbusServo, SERVO, peer=peer_of(drive, "tcp", tmp_path))
