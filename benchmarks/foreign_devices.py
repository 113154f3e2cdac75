"""Drives on stacks of other authors, driven by rigd's drivers: as on rigd's own simulated devices?

On each stack a drive is opened, its watchdog proven, armed, driven, read back, made safe and closed
by a process that cycles as rigd's does; then again, and that process is killed (SIGKILL) while the
drive moves. Once the connection is quiet, once others use it: on CAN 1,000 frames/s of other nodes
and a second SDO client, on Modbus TCP a second client. What the drive did it states itself, in
lines of its own; nothing of rigd is in it.

    python benchmarks/foreign_devices.py --sources FOLDER
                        FOLDER has clones of CANopenNode (on GitHub CANopenNode/CANopenNode) and
                        lely-core (lely-industries/lely-core), which is built beside it; what is
                        not there is "not run"
    python benchmarks/foreign_devices.py --only modbus
                        stacks whose name holds the word
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import shutil
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.cards.scanned_drive import ETA, REGISTERS, ScannedDrive, Scanner
from support.instruments.pty_port import PtyPort
from support.wire import free_ports

from rigd.model.errors import RigdError
from rigd.sdk import Driver
from rigd.sdk.check import background_loop
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.cia402_servo.current import CurrentServo, CurrentServoConfig
from rigd_drivers.can.cia402_servo.rotary import RotaryServo, RotaryServoConfig
from rigd_drivers.modbus.servo import ModbusServo, ServoConfig
from rigd_sim.wire.can.disturbance import CAN_FRAME
from rigd_sim.wire.can.hub import CanHub

HERE: Final = Path(__file__).parent
#: Cycles of rigd's own rate are not what is judged here.
PERIOD_S: Final = 0.002
DRIVE_S: Final = 1.0
#: A loaded machine starts, opens and proves within this.
PATIENCE_S: Final = 60.0
RATED_A: Final = 1.5
COUNTS_PER_TURN: Final = 4096
BUS: Final = "BUS"
RPM: Final = 0.10471975511965977


class NotRun(Exception):
    """This stack cannot be had on this machine; says why."""


# -- the process that cycles -------------------------------------------------------------------


def make(spec: dict[str, Any]) -> tuple[Driver[Any, Any], CanBus | None]:
    """Return the driver of ``spec``, and its link."""
    if spec["kind"] == "modbus":
        return ModbusServo(ServoConfig.model_validate(spec["options"]), None), None
    link = CanBus(CanBusConfig(interface="hub", channel=spec["channel"]))
    if spec["kind"] == "current":
        return CurrentServo(CurrentServoConfig.model_validate(spec["options"]), link), link
    return RotaryServo(RotaryServoConfig.model_validate(spec["options"]), link), link


def play(spec: dict[str, Any]) -> None:
    """Open, prove, arm, drive and read; then make safe and close, or drive on until killed."""

    def say(what: str, **more: Any) -> None:
        print(json.dumps({"said": what, "at": time.monotonic_ns(), **more}), flush=True)

    driver, link = make(spec)
    rows: list[Any] = []

    def cycle(setpoint: float) -> None:
        now = time.monotonic_ns()
        if link is not None:
            link.begin(now)
        row = driver.read(now)
        if row is not None:
            rows.append(row)
        driver.write((setpoint,))
        if link is not None:
            link.end(now)
        time.sleep(max(0.0, PERIOD_S - (time.monotonic_ns() - now) * 1e-9))

    try:
        if link is not None:
            link.open()
        driver.open()
        say("opened", identity=getattr(driver, "identity", ""))
        say("proven", seconds=driver.prove_watchdog())
        for _ in range(20):
            cycle(0.0)
        driver.arm()
        end = time.monotonic() + PATIENCE_S
        while not driver.ready() and time.monotonic() < end:
            cycle(0.0)
        say("armed")
        rows.clear()
        end = time.monotonic() + DRIVE_S
        while time.monotonic() < end:
            cycle(spec["setpoint"])
        late = rows[len(rows) // 2 :]
        column = 1 if spec["kind"] == "speed" else 0  # the angle is first there
        value = statistics.median(row[column] for row in late)
        say("driven", value=value, rows=len(rows))
        while spec["kill"]:
            cycle(spec["setpoint"])
        driver.make_safe()
        driver.confirm_safe()
        say("safe")
        driver.close()
        if link is not None:
            link.close()
        say("closed")
    except RigdError as error:
        say("refused", why=str(error))
        with suppress(RigdError):
            driver.make_safe()


# -- the devices -------------------------------------------------------------------------------


@dataclass
class Device:
    """A drive that runs: what rigd's driver needs, and what the drive has stated."""

    spec: dict[str, Any]
    log: Path
    setpoint: float
    node_unit: float  #: of the drive's own figure, in the unit of the setpoint
    beside: Callable[[threading.Event], None] | None = None

    def lines(self) -> list[tuple[int, int, float]]:
        """Return when, whether it was enabled, and with what it was driven from then on."""
        found = []
        for line in self.log.read_text().splitlines():
            first, *rest = line.split()
            if first.isdigit():
                enabled, *driven = map(int, rest)
                index = 1 if self.spec["kind"] == "speed" else 0
                found.append((int(first), enabled, driven[index] * self.node_unit))
        return found


@contextmanager
def program(log: Path, *command: str | Path) -> Iterator[None]:
    """Run a device; what it states goes to ``log``."""
    words = list(map(str, command))
    with (
        log.open("w") as file,
        log.with_suffix(".told").open("w") as told,  # what the stack tells its developers
        subprocess.Popen(words, stdout=file, stderr=told) as process,
    ):
        try:
            yield
        finally:
            process.kill()


@contextmanager
def bus() -> Iterator[Path]:
    """A simulated bus of rigd, in a process of its own."""
    folder = Path(tempfile.mkdtemp(prefix="rigd-", dir="/tmp"))
    command = [sys.executable, __file__, "--serve", "bus", str(folder / "bus")]
    with subprocess.Popen(command) as process:
        try:
            wait_for(partial(_joins, folder / "bus"))
            yield folder / "bus"
        finally:
            process.terminate()
            process.wait()
            shutil.rmtree(folder)


def wait_for(true: Callable[[], object]) -> None:
    """Wait for it.

    Raises:
        TimeoutError: it does not come true.
    """
    end = time.monotonic() + PATIENCE_S
    while not true():
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(0.01)


def others_on_can(path: Path, ended: threading.Event) -> None:
    """Send 1,000 frames/s of other nodes, and ask the drive by SDO 50 times/s, until ``ended``."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as place:
        place.connect(str(path))
        place.setblocking(False)
        ask = CAN_FRAME.pack(0x601, 8, bytes.fromhex("40 41 60 00 00 00 00 00"))
        sent, begin = 0, time.monotonic()
        while not ended.is_set():
            while sent < 1000 * (time.monotonic() - begin):
                with suppress(BlockingIOError):
                    place.send(CAN_FRAME.pack(0x4A0 + sent % 16, 8, bytes(8)))
                    if sent % 20 == 0:
                        place.send(ask)
                sent += 1
            with suppress(BlockingIOError):
                while place.recv(16):
                    pass
            time.sleep(0.002)


def others_on_modbus(port: int, ended: threading.Event) -> None:
    """Read the drive's status word 100 times/s on a connection of its own, until ``ended``."""
    with socket.create_connection(("127.0.0.1", port)) as place:
        place.settimeout(PATIENCE_S)
        number = 0
        while not ended.wait(0.01):
            number += 1
            place.sendall(struct.pack(">HHHBBHH", number & 0xFFFF, 0, 6, 1, 3, ETA, 1))
            place.recv(64)


@contextmanager
def on_can(
    command: Sequence[str | Path], kind: str, options: dict[str, Any], folder: Path
) -> Iterator[Device]:
    """A drive of CANopen that ``command`` starts, with :data:`BUS` for the place of the bus."""
    with bus() as path:
        log = folder / "log"
        with program(log, *(path if each == BUS else each for each in command)):
            wait_for(partial(_answers, path))
            given = {"node": 1, "counts_per_revolution": "4096 count/rev", **options}
            beside = partial(others_on_can, path)
            spec = {"kind": kind, "channel": str(path), "options": given}
            if kind == "current":
                given |= {"current_range": "1.5 A", "rated_current": "1.5 A"}
                yield Device(spec, log, 0.2, RATED_A / 1000, beside)
            else:
                given |= {"speed_range": "50 rad/s"}
                yield Device(spec, log, 20.0, 2 * math.pi / COUNTS_PER_TURN, beside)


@contextmanager
def on_modbus(command: Sequence[str | Path], folder: Path) -> Iterator[Device]:
    """A drive on Modbus TCP that ``command`` starts, with the port at its end."""
    (port,) = free_ports(1)
    log = folder / "log"
    with program(log, *command, str(port)):
        wait_for(lambda: _listens(port))
        spec = {
            "kind": "modbus",
            "options": {
                "host": "127.0.0.1", "port": port, "map": "schneider-atv320",
                "max_speed": "3000 rpm", "watchdog": "0.5 s", "timeout": "0.2 s",
            },
        }  # fmt: skip
        yield Device(spec, log, 600 * RPM, RPM, partial(others_on_modbus, port))


@contextmanager
def on_line(command: Sequence[str | Path], folder: Path) -> Iterator[Device]:
    """A drive on a serial line, which ``command`` makes: a link is its last word."""
    log, place = folder / "log", folder / "tty"
    with program(log, *command, place):
        wait_for(place.is_symlink)
        spec = {
            "kind": "modbus",
            "options": {
                "serial_port": str(place.readlink()), "baud": 115200, "parity": "none",
                "map": "schneider-atv320", "max_speed": "3000 rpm", "watchdog": "0.5 s",
                "timeout": "0.2 s", "longest_reply": "0.2 s",
            },
        }  # fmt: skip
        yield Device(spec, log, 600 * RPM, RPM)


def _joins(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as place:
        return place.connect_ex(str(path)) == 0


def _answers(path: Path) -> bool:
    """Return whether the node at ``path`` answers an SDO client."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as place:
        place.connect(str(path))
        place.settimeout(2.0)
        place.send(CAN_FRAME.pack(0x601, 8, bytes.fromhex("40 00 10 00 00 00 00 00")))
        with suppress(TimeoutError):
            while place.recv(16)[:2] != b"\x81\x05":
                pass
            return True
        return False


def _listens(port: int) -> bool:
    with socket.socket() as place:
        return place.connect_ex(("127.0.0.1", port)) == 0


# -- servers of other authors in Python, each in a process of its own --------------------------


def state(enabled: bool, rpm: int) -> None:
    """State what the motor gets from now on, as the programs in C do."""
    print(time.monotonic_ns(), int(enabled), rpm, flush=True)


def serve_bus(place: str) -> None:
    """Serve a simulated bus until this process is ended."""
    with background_loop() as run:
        hub = CanHub("bus", Path(place))
        run(hub.start())
        signal.sigwait({signal.SIGTERM, signal.SIGINT})


def serve_pymodbustcp(port: str) -> None:
    """Serve the drive on pyModbusTCP."""
    drive = ScannedDrive(0.002, state, int(port))
    drive.start()
    signal.pause()


class SlaveBank:
    """The registers of a slave of modbus-tk."""

    def __init__(self, slave: Any) -> None:
        self._slave = slave
        self.at = 0.0

    def word(self, address: int) -> int:
        """Return a register."""
        return int(self._slave.get_values("holding", address, 1)[0])

    def show(self, address: int, word: int) -> None:
        """Set a register."""
        self._slave.set_values("holding", address, [word])


def serve_modbus_tk(place: str) -> None:
    """Serve the drive on modbus-tk's RTU server, on a pseudo-terminal."""
    from modbus_tk import defines, hooks, modbus_rtu

    master, line = os.openpty()
    tty.setraw(line)
    server = modbus_rtu.RtuServer(PtyPort(master, os.ttyname(line)))
    slave = server.add_slave(1)
    slave.add_block("holding", defines.HOLDING_REGISTERS, 0, REGISTERS)
    bank = SlaveBank(slave)

    def heard(_: object) -> None:
        bank.at = time.monotonic()

    hooks.install_hook("modbus.Server.before_handle_request", heard)
    Scanner(bank, 0.002, state).start()
    server.start()
    Path(place).symlink_to(os.ttyname(line))
    signal.pause()


class SimBank:
    """The registers of a device of pymodbus, as its action sees them."""

    def __init__(self) -> None:
        self.words = [0] * REGISTERS
        self.at = 0.0

    def word(self, address: int) -> int:
        """Return a register."""
        return self.words[address]

    def show(self, address: int, word: int) -> None:
        """Set a register."""
        self.words[address] = word

    async def asked(
        self, function: int, first: int, address: int, count: int, words: list[int], new: Any
    ) -> None:
        """Keep what is written, and show what is read."""
        self.at = time.monotonic()
        place = address - first
        if new is not None:
            self.words[address : address + count] = new
        words[place : place + count] = self.words[address : address + count]


def serve_pymodbus(port: str) -> None:
    """Serve the drive on pymodbus."""
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    bank = SimBank()
    Scanner(bank, 0.002, state).start()

    async def serve() -> None:
        data = SimData(0, values=[0] * REGISTERS, datatype=DataType.REGISTERS)
        device = SimDevice(1, simdata=[data], action=bank.asked)
        server = ModbusTcpServer(device, address=("127.0.0.1", int(port)))
        await server.serve_forever()

    asyncio.run(serve())


def serve_canopen(place: str) -> None:
    """Serve a local node of canopen, of the shipped EDS: no state machine, and no watchdog."""
    import can
    import canopen
    from support.can.eds import SHIPPED

    class HubBus(can.BusABC):
        """The simulated bus, for python-can."""

        def __init__(self) -> None:
            super().__init__(channel=place)
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._socket.connect(place)

        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            data = bytes(msg.data)
            self._socket.send(CAN_FRAME.pack(msg.arbitration_id, len(data), data))

        def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
            self._socket.settimeout(timeout)
            try:
                packet = self._socket.recv(16)
            except TimeoutError:
                return None, False
            if not packet:
                os._exit(0)  # the bus is gone
            identifier, length, data = CAN_FRAME.unpack(packet)
            message = can.Message(
                arbitration_id=identifier, is_extended_id=False, data=data[:length]
            )
            return message, False

    bus = HubBus()
    network = canopen.Network(bus)
    network.notifier = can.Notifier(bus, network.listeners, 0.1)
    node: Any = network.create_node(1, str(SHIPPED / "rigd_servo.eds"))
    known = {0x6075: 1500, 0x6076: 45, 0x6502: 1 << 9 | 1 << 8, 0x6073: 1333}
    for index, value in known.items():
        node.sdo[index].raw = value
    node.sdo[0x1018][4].raw = 1
    node.sdo[0x608F][1].raw, node.sdo[0x608F][2].raw = COUNTS_PER_TURN, 1

    def written(index: int, subindex: int, od: Any, data: bytes) -> None:
        if index == 0x6060:
            node.sdo[0x6061].raw = data[0]
        if index == 0x6040:
            status = {6: 0x231, 7: 0x233, 15: 0x1237}.get(int.from_bytes(data, "little"), 0x250)
            node.sdo[0x6041].raw = status
            print(time.monotonic_ns(), int(status == 0x1237), 0, 0, flush=True)

    node.add_write_callback(written)
    node.sdo[0x6041].raw = 0x250
    signal.pause()


SERVERS: Final[dict[str, Callable[[str], None]]] = {
    "bus": serve_bus,
    "pyModbusTCP": serve_pymodbustcp,
    "modbus-tk": serve_modbus_tk,
    "pymodbus": serve_pymodbus,
    "canopen": serve_canopen,
}


def served(name: str) -> list[str | Path]:
    """Return the command that serves one of them, but for the place."""
    return [sys.executable, __file__, "--serve", name]


# -- what must be built ------------------------------------------------------------------------


def compile_c(target: Path, *arguments: str | Path) -> Path:
    """Compile a program.

    Raises:
        NotRun: no compiler, or it refuses.
    """
    if shutil.which("cc") is None:
        raise NotRun("no C compiler: scripts/need cc")
    command = ["cc", "-O1", "-I", HERE / "foreign", "-o", target, *arguments]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotRun(f"cc: {done.stderr.strip().splitlines()[0]}")
    return target


def cloned(sources: Path, name: str) -> Path:
    """Return the clone ``name``.

    Raises:
        NotRun: there is none.
    """
    if not (sources / name).is_dir():
        raise NotRun(f"no clone of it as {sources / name}")
    return sources / name


def commit_of(clone: Path) -> str:
    """Return the commit of ``clone``."""
    command = ["git", "-C", str(clone), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


PARTS = (
    "301/CO_ODinterface", "301/CO_NMT_Heartbeat", "301/CO_HBconsumer", "301/CO_Emergency",
    "301/CO_SDOserver", "301/CO_TIME", "301/CO_SYNC", "301/CO_PDO", "CANopen", "example/OD",
)  # fmt: skip


def canopennode(sources: Path, folder: Path) -> tuple[Path, str]:
    """Build the drive on CANopenNode; return it and the version of the stack."""
    clone = cloned(sources, "CANopenNode")
    parts = [clone / f"{part}.c" for part in PARTS]
    node = HERE / "foreign" / "canopennode.c"
    program = compile_c(folder / "canopennode", "-I", clone, "-I", clone / "example", node, *parts)
    return program, commit_of(clone)


def lely(sources: Path, folder: Path) -> tuple[Path, str]:
    """Build the drive on lely-core, and it beside its clone if need be; see :func:`canopennode`."""
    clone = cloned(sources, "lely-core")
    prefix = sources / "lely-installed"
    if not (prefix / "lib" / "liblely-co.so").exists():
        build_lely(clone, sources / "lely-built", prefix)
    libraries = [f"-Wl,-rpath,{prefix}/lib", "-llely-co", "-llely-can", "-llely-util"]
    program = compile_c(
        folder / "lely", "-I", prefix / "include", HERE / "foreign" / "lely.c", "-L",
        prefix / "lib", *libraries,
    )  # fmt: skip
    return program, commit_of(clone)


def build_lely(clone: Path, built: Path, prefix: Path) -> None:
    """Build and install lely-core: five minutes.

    Raises:
        NotRun: a tool is missing, or fails.
    """
    built.mkdir(exist_ok=True)
    without = ("cxx", "tests", "unit-tests", "tools", "static", "python")
    steps: list[tuple[Path, list[str]]] = [
        (clone, ["autoreconf", "-i"]),
        (built, [str(clone / "configure"), f"--prefix={prefix}"]
         + [f"--disable-{each}" for each in without]),
        (built, ["make", "-j2", "install"]),
    ]  # fmt: skip
    for folder, command in steps:
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            raise NotRun(f"no {command[0]}: apt-get install autoconf automake libtool") from None
        if done.returncode:
            raise NotRun(f"{command[0]} fails: {(done.stderr.strip().splitlines() or ['?'])[-1]}")


def libmodbus(sources: Path, folder: Path) -> tuple[Path, str]:
    """Build the drive on the libmodbus of this system; see :func:`canopennode`."""
    found = subprocess.run(
        ["sh", "-c", "pkg-config --modversion libmodbus"],
        capture_output=True,
        text=True,
        check=False,
    )
    if found.returncode:
        raise NotRun("no libmodbus: apt-get install libmodbus-dev pkg-config")
    arguments: list[str | Path] = [
        "-I/usr/include/modbus",
        HERE / "foreign" / "modbus_drive.c",
        "-lmodbus",
    ]
    return compile_c(folder / "modbus_drive", *arguments), found.stdout.strip()


# -- the table ---------------------------------------------------------------------------------


@dataclass
class Stack:
    """A stack to be played, and how."""

    name: str
    what: str
    version: str
    device: Callable[[Path], Any]
    crowded: bool = True  #: whether others can use its connection too
    refused: dict[str, str] = field(
        default_factory=dict
    )  #: by condition: words of the refusal that is right


def stacks(sources: Path, folder: Path, only: str) -> tuple[list[Stack], list[tuple[str, str]]]:
    """Return the stacks that can be played here, and the others with the reason."""
    found: list[Stack] = []
    missing: list[tuple[str, str]] = []

    def built(name: str, how: Callable[[Path, Path], tuple[Path, str]]) -> tuple[Path, str] | None:
        if only.lower() not in name.lower():
            return None
        try:
            return how(sources, folder)
        except NotRun as error:
            missing.append((name, str(error)))
            return None

    eds = HERE.parent / "configs" / "eds" / "rigd_servo.eds"
    unit = {"velocity_unit": f"{2 * math.pi / COUNTS_PER_TURN} rad/s"}
    plain: list[tuple[str, str, dict[str, Any]]] = [
        ("current", "current", {}), ("speed", "speed", unit), ("no unit", "speed", {}),
    ]  # fmt: skip
    told = "does not report the unit of its velocities"

    def nodes(name: str, version: str, command: Sequence[str | Path]) -> Iterator[Stack]:
        for what, kind, options in plain:
            device = partial(on_can, command, kind, options)
            wrong = {"quiet": told, "crowded": told} if what == "no unit" else {}
            yield Stack(name, what, version, device, refused=wrong)

    if made := built("CANopenNode", canopennode):
        node, commit = made
        found += nodes("CANopenNode", commit, [node, BUS])
        device = partial(on_can, [node, BUS, "epos4"], "current", {"profile": "maxon-epos4"})
        found.append(Stack("CANopenNode", "EPOS4, current", commit, device))
    if made := built("lely-core", lely):
        node, commit = made
        found += nodes("lely-core", commit, [node, BUS, eds])
    if only.lower() in "canopen":
        device = partial(on_can, [*served("canopen"), BUS], "current", {})
        refused = dict.fromkeys(("quiet", "crowded"), "did not switch itself off")
        found.append(Stack("canopen", "no watchdog", version("canopen"), device, refused=refused))
    if made := built("libmodbus", libmodbus):
        drive, number = made
        found.append(Stack("libmodbus", "speed, TCP", number, partial(on_modbus, [drive])))
    for name in ("pyModbusTCP", "pymodbus"):
        # Their drive takes any request for a sign of life: a second client feeds its watchdog.
        device = partial(on_modbus, served(name))
        refused = {"crowded": "watchdog"}
        if only.lower() in name.lower():
            found.append(Stack(name, "speed, TCP", version(name), device, refused=refused))
    if only.lower() in "modbus-tk":
        device = partial(on_line, served("modbus-tk"))
        found.append(Stack("modbus-tk", "speed, RTU", version("modbus_tk"), device, crowded=False))
    return found, missing


def cycled(device: Device, *, kill: bool) -> dict[str, Any]:
    """Let a process drive the device; return what it said, and when it was killed."""
    spec = device.spec | {"setpoint": device.setpoint, "kill": kill}
    command = [sys.executable, __file__, "--cycle", json.dumps(spec)]
    said: dict[str, Any] = {}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            told = json.loads(line)
            said[told["said"]] = told
            if told["said"] == "driven" and kill:
                time.sleep(0.05)
                said["killed"] = {"at": time.monotonic_ns()}
                process.send_signal(signal.SIGKILL)
    return said


def off_after_ms(device: Device, since_ns: int) -> float | None:
    """Return when the drive stated that it is off; None: it never did."""

    def found() -> list[int]:
        return [at for at, enabled, _ in device.lines() if at > since_ns and not enabled]

    with suppress(TimeoutError):
        end = time.monotonic() + 10
        wait_for(lambda: found() or time.monotonic() > end)
    return (found()[0] - since_ns) * 1e-6 if found() else None


@dataclass
class Row:
    """What one stack showed under one condition."""

    stack: Stack
    condition: str
    proven_ms: float | None = None
    wanted: float = 0.0
    measured: float | None = None
    driven: float | None = None
    killed_ms: float | None = None
    refused: str = ""
    wrong: list[str] = field(default_factory=list)


def judge(row: Row, device: Device, said: dict[str, Any]) -> None:
    """Enter what a whole life of the driver showed."""
    lines = device.lines()
    if "refused" in said:
        row.refused = said["refused"]["why"]
    right = row.stack.refused.get(row.condition)
    if right is not None:
        if right not in row.refused:
            row.wrong.append(f"not refused for {right!r}: {row.refused or 'all was done'}")
    elif "closed" not in said:
        row.wrong.append(f"after {list(said)}: {row.refused or 'the process ended'}")
    if "proven" in said:
        row.proven_ms = 1e3 * said["proven"]["seconds"]
    if "driven" in said:
        row.measured = said["driven"]["value"]
        inside = [driven for at, on, driven in lines if on and at < said["driven"]["at"]]
        row.driven = inside[-1] if inside else None
        for name, value in (("measured", row.measured), ("driven", row.driven)):
            if value is None or abs(value - row.wanted) > 0.005 * abs(row.wanted) + 0.001:
                row.wrong.append(f"{name} {value}, set {row.wanted}")
    if lines and lines[-1][1]:
        row.wrong.append("enabled at the end")


def play_stack(stack: Stack, condition: str) -> Row:
    """Play a whole life, and one that is killed."""
    row = Row(stack, condition)
    for kill in (False, True):
        with ExitStack() as inside:
            folder = Path(inside.enter_context(tempfile.TemporaryDirectory()))
            device: Device = inside.enter_context(stack.device(folder))
            row.wanted = device.setpoint
            if condition == "crowded" and device.beside is not None:
                ended = threading.Event()
                thread = threading.Thread(target=device.beside, args=(ended,))
                thread.start()
                inside.callback(thread.join)
                inside.callback(ended.set)
            said = cycled(device, kill=kill)
            if not kill:
                judge(row, device, said)
                if row.refused:
                    return row
            elif "killed" not in said:
                row.wrong.append(f"the second life ended after {list(said)}: {said.get('refused')}")
            else:
                row.killed_ms = off_after_ms(device, said["killed"]["at"])
                if row.killed_ms is None:
                    row.wrong.append("stays enabled after the kill")
    return row


def show(rows: list[Row], missing: list[tuple[str, str]]) -> bool:
    """Print the table; return whether all is as it must be."""
    print(f"{'stack':<12} {'version':<10} {'drive':<15} {'beside':<8} {'proven ms':>9} {'set':>8}"
          f" {'measured':>9} {'at node':>9} {'killed ms':>9}  verdict")  # fmt: skip
    for row in rows:
        numbers = [
            "" if each is None else format(each, kind)
            for each, kind in (
                (row.proven_ms, ".0f"), (row.wanted, ".4g"), (row.measured, ".4g"),
                (row.driven, ".4g"), (row.killed_ms, ".0f"),
            )
        ]  # fmt: skip
        proven, wanted, measured, driven, killed = numbers
        refused = f"refused, as it must be: {row.refused}" if row.refused else "ok"
        verdict = f"WRONG: {'; '.join(row.wrong)}" if row.wrong else refused
        print(f"{row.stack.name:<12} {row.stack.version:<10} {row.stack.what:<15}"
              f" {'others' if row.condition == 'crowded' else '-':<8} {proven:>9} {wanted:>8}"
              f" {measured:>9} {driven:>9} {killed:>9}  {verdict}")  # fmt: skip
    for name, why in missing:
        print(f"{name:<12} not run: {why}")
    noted("foreign devices, stacks run", len({row.stack.name for row in rows}), "")
    noted("foreign devices, stacks not run", len(missing), "")
    wrong = sum(bool(row.wrong) for row in rows)
    at_most("foreign devices, not as they must be", wrong, 0, "rows")
    return not wrong


def main() -> int:
    """Play every stack that can be had, quiet and crowded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sources", type=Path, default=HERE.parent / "build" / "foreign")
    parser.add_argument("--only", default="", metavar="WORD")
    parser.add_argument("--cycle", help=argparse.SUPPRESS)
    parser.add_argument("--serve", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.cycle:
        play(json.loads(args.cycle))
        return 0
    if args.serve:
        name, place = args.serve
        SERVERS[name](place)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        found, missing = stacks(args.sources, Path(folder), args.only)
        rows = []
        for stack in found:
            for condition in ("quiet", "crowded") if stack.crowded else ("quiet",):
                rows.append(play_stack(stack, condition))
                told = "; ".join(rows[-1].wrong) or rows[-1].refused or "ok"
                print(f"{stack.name}, {stack.what}, {condition}: {told}", flush=True)
    return 0 if show(rows, missing) else 1


if __name__ == "__main__":
    sys.exit(main())
