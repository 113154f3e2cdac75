"""Classes of PyMeasure at instruments of others: rows, setpoints, safe, refusals."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from support.instruments.supply_2260b import FAULTS, Supply2260B, Voltages

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd.sdk.check import Observed, Peer, check_driver
from rigd_drivers.instruments.polling import PolledStatus
from rigd_drivers.instruments.pymeasure_bridge import driver as module
from rigd_drivers.instruments.pymeasure_bridge.config import PymeasureConfig
from rigd_drivers.instruments.pymeasure_bridge.driver import Pymeasure
from rigd_drivers.instruments.pymeasure_bridge.helper import Session
from rigd_drivers.instruments.pymeasure_bridge.process import _END_S, OPEN_S, Process

SUPPLY: dict[str, Any] = {
    "instrument": "pymeasure.instruments.keithley.Keithley2260B",
    "visa_library": "@py",
    "channels": {
        "voltage": {"read": "voltage", "unit": "V", "low": "-1 V", "high": "33 V"},
        "current": {"read": "current", "unit": "A", "low": "-5 A", "high": "5 A"},
    },
    "setpoints": {
        "voltage": {"write": "voltage_setpoint", "read": "voltage_setpoint", "unit": "mV",
                    "low": "0 V", "high": "40 V", "within": "1 mV"},
    },
    "start": "clear",
    "arm": {"output_enabled": "true"},
    "safe": ["shutdown", {"voltage_setpoint": "0"}],
    "state": {"read": "output_enabled", "safe": "false", "ready": "true"},
    "identify": "id",
    "errors": "check_errors",
    "period": "0.05 s",
    "timeout": "0.2 s",
    "silence": "1 s",
}  # fmt: skip
#: What its class takes and gives is in V; the setpoint is declared in V where it matters.
VOLTS = {"voltage": {**SUPPLY["setpoints"]["voltage"], "unit": "V"}}
Scene = Callable[[Pymeasure, Supply2260B], Awaitable[None]]

METER = """\
spec: "1.1"
devices:
  meter:
    eom: {GPIB INSTR: {q: "\\r\\n", r: "\\n"}}
    error: ERROR
    dialogues:
      - {q: "*IDN?", r: "KEITHLEY,MODEL 2000,1,A"}
      - {q: ":READ?", r: "VALUE"}
      - {q: ":CONF:VOLT:DC"}
      - {q: ":CONF:TEMP"}
resources:
  GPIB0::16::INSTR: {device: meter}
"""
READS: dict[str, Any] = {
    "instrument": "pymeasure.instruments.keithley.Keithley2000",
    "address": "GPIB0::16::INSTR",
    "channels": {"voltage": {"read": "voltage", "unit": "mV"}},
    "identify": "id",
    "start": {"mode": "voltage"},
    "timeout": "0.2 s",
    "silence": "0.5 s",
}


def supply_config(supply: Supply2260B, **options: Any) -> PymeasureConfig:
    return PymeasureConfig.model_validate(
        {**SUPPLY, "setpoints": VOLTS, "address": supply.address, **options}
    )


def play(scene: Scene, **options: Any) -> None:
    """Play ``scene`` with an open driver at a simulated supply."""
    supply = Supply2260B()

    async def main() -> None:
        driver = Pymeasure(supply_config(supply, **options), None)
        try:
            await driver.open()
            await scene(driver, supply)
        finally:
            await driver.close()

    try:
        asyncio.run(main())
    finally:
        if supply.fault != "dead":
            supply.stop()


async def rows_of(driver: Pymeasure, count: int) -> list[Sequence[float]]:
    rows: list[Sequence[float]] = []
    enough = asyncio.Event()

    def emit(row: Sequence[float]) -> None:
        rows.append(row)
        if len(rows) >= count:
            enough.set()

    task = asyncio.create_task(driver.run(emit))
    waiting = asyncio.create_task(enough.wait())
    await asyncio.wait({task, waiting}, timeout=30, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    task.cancel()
    await asyncio.wait({task})
    if not task.cancelled() and (error := task.exception()) is not None:
        raise error
    return rows


async def armed(driver: Pymeasure, volts: float = 5.0) -> None:
    await driver.write([0.0])
    await driver.arm()
    await driver.write([volts])


def read_meter(folder: Path, value: str, **options: Any) -> tuple[str, Sequence[float]]:
    """Return identity and first row of a meter that answers ``value``."""
    (folder / "meter.yaml").write_text(METER.replace("VALUE", value))
    library = {"visa_library": "meter.yaml@sim"}
    config = PymeasureConfig.model_validate(
        {**READS, **library, **options}, context={"folder": folder}
    )

    async def main() -> tuple[str, Sequence[float]]:
        driver = Pymeasure(config, None)
        try:
            await driver.open()
            (row, *_) = await rows_of(driver, 1)
            return driver.identity, row
        finally:
            await driver.close()

    return asyncio.run(main())


def test_meter_gives_its_value_in_si(tmp_path: Path) -> None:
    identity, row = read_meter(tmp_path, "+1.250E+03")
    assert identity == "KEITHLEY,MODEL 2000,1,A"
    assert row == (1.25, 0)


def test_infinite_reading_is_nan_with_its_bit(tmp_path: Path) -> None:
    _, (value, status) = read_meter(tmp_path, "9.9E37")
    assert value != value
    assert status == PolledStatus.BEYOND


@pytest.mark.parametrize(
    ("value", "options", "kind", "words"),
    [
        ("OPEN", {}, ProtocolError, r"GPIB0::16::INSTR has voltage = 'OPEN', which is no number"),
        ("1,2", {}, ProtocolError, r"has voltage = \[1\.0, 2\.0\] \(list\), which is no number"),
        ("1.0", {"model": "2001"}, ProtocolError, "which has no '2001'"),
        ("1.0", {"channels": {"v": {"read": "voltage", "unit": "mV", "high": "0.5 mV"}}},
         ProtocolError, "has voltage = 1.0, beyond the range of v"),
        ("1.0", {"address": "nonsense"}, LinkError, "at nonsense cannot be opened"),
        ("1.0", {"start": (), "channels": {"v": {"read": "mode", "unit": "1"}}},
         ProtocolError, "mode cannot be read: KeyError: 'Value ERROR not found"),
        ("1.0", {"connection": {"no_such": "1"}}, LinkError, "cannot be opened: .*no_such"),
    ],
)  # fmt: skip
def test_meter_that_does_not_fit_is_named(
    tmp_path: Path, value: str, options: dict[str, Any], kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words):
        read_meter(tmp_path, value, **options)


def test_supply_is_set_and_made_safe() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        assert driver.identity == "ACME,PS30,0042,1.7"
        assert supply.heard[0] == "*CLS"
        await driver.write([0.0])
        assert not supply.output
        await driver.arm()
        await driver.write([7.5])
        assert supply.driven == 7.5
        rows = await rows_of(driver, 3)
        assert [tuple(row) for row in rows] == [(7.5, 0.75, 0)] * 3
        await driver.make_safe()
        assert (supply.output, supply.volts) == (False, 0.0)
        await driver.make_safe()

    play(scene)


def test_setpoint_goes_out_in_its_unit() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await driver.write([0.0123])
        assert "SOUR:VOLT 12.3" in supply.heard

    play(scene, setpoints=SUPPLY["setpoints"])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("locked", "has output_enabled = False, expected true: its output is not on"),
        ("stuck", r"was given voltage_setpoint = 5\.0, and has voltage_setpoint = 0\.0"),
    ],
)
def test_supply_that_does_not_obey_is_a_fault(fault: str, words: str) -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await driver.write([0.0])
        if fault != "locked":
            await driver.arm()
        supply.fail(fault)
        with pytest.raises(DeviceError, match=words):
            await (driver.arm() if fault == "locked" else driver.write([5.0]))

    play(scene)


def test_supply_that_stays_on_is_not_safe() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await armed(driver)
        supply.fail("stuck")
        with pytest.raises(DeviceError, match="output_enabled = True after `safe`, expected false"):
            await driver.make_safe()

    play(scene)


def test_rescue_makes_safe_before_it_reads_anything() -> None:
    supply = Supply2260B()
    try:
        supply.output = True
        config = supply_config(supply, start=(), model="another")
        asyncio.run(Pymeasure(config, None).rescue())
        assert not supply.output
        assert supply.heard[0] == "OUTPut 0"
    finally:
        supply.stop()


def test_silent_supply_obeys_and_is_not_reported_safe() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await armed(driver)
        supply.fail("silent")
        measuring = asyncio.create_task(rows_of(driver, 1))
        await asyncio.sleep(0.05)
        with pytest.raises(LinkError, match=r"does not answer within 0\.2 s"):
            await driver.make_safe()
        assert not supply.output
        measuring.cancel()
        await asyncio.wait({measuring})

    play(scene)


def test_dead_supply_is_not_reported_safe() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await armed(driver)
        supply.fail("dead")
        with pytest.raises(LinkError, match=r"cannot be opened|is lost|does not answer"):
            await driver.make_safe()

    play(scene)


def test_output_that_goes_off_is_a_fault() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await armed(driver)
        supply.output = False
        with pytest.raises(DeviceError, match="its output is not on any more"):
            await rows_of(driver, 1000)

    play(scene)


def test_error_of_queue_is_named() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        with pytest.raises(DeviceError, match=r"(?s)-222.*Data out of range.*when voltage is set"):
            await driver.write([35.0])

    play(scene)


def test_lost_answers_leave_out_rows_only() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        assert (await rows_of(driver, 1))[0][-1] == 0
        supply.fail("silent")
        task = asyncio.create_task(rows_of(driver, 1))
        await asyncio.sleep(0.3)
        supply.fail("")
        (row, *_) = await task
        assert row[-1] == PolledStatus.INCOMPLETE

    play(scene, errors=None)


def test_process_that_is_killed_is_replaced_for_safe() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await armed(driver)
        own = driver._process
        assert own is not None
        assert own._child is not None
        os.kill(own._child.pid, signal.SIGKILL)
        with pytest.raises(LinkError, match="its process was ended by SIGKILL"):
            await rows_of(driver, 1)
        await driver.make_safe()
        assert not supply.output

    play(scene)


def test_replacing_process_makes_safe_when_it_ends() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await armed(driver)
        first = driver._process
        assert first is not None
        first.kill()
        other = driver._new_process(acted=True)
        await driver._begin(other)
        assert supply.output
        await other.end()
        assert not supply.output

    play(scene)


ALONE = """
import asyncio, json, sys
from rigd_drivers.instruments.pymeasure_bridge.config import PymeasureConfig
from rigd_drivers.instruments.pymeasure_bridge.driver import Pymeasure
async def main():
    driver = Pymeasure(PymeasureConfig.model_validate(json.loads(sys.argv[1])), None)
    await driver.open()
    await driver.write([0.0])
    await driver.arm()
    await driver.write([5.0])
    print("on", flush=True)
    await asyncio.sleep(60)
asyncio.run(main())
"""


def test_killed_daemon_leaves_supply_safe() -> None:
    supply = Supply2260B()
    options = supply_config(supply).model_dump_json(exclude={"period", "timeout", "silence"})
    try:
        with subprocess.Popen(
            [sys.executable, "-c", ALONE, options], stdout=subprocess.PIPE, text=True
        ) as daemon:
            assert daemon.stdout is not None
            assert daemon.stdout.readline() == "on\n"
            assert supply.driven == 5.0
            daemon.kill()
        deadline = time.monotonic() + 30
        while supply.output and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not supply.output
    finally:
        supply.stop()


def test_missing_package_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    config = PymeasureConfig.model_validate(
        {**SUPPLY, "setpoints": VOLTS, "address": "TCPIP::127.0.0.1::1::SOCKET"}
    )
    monkeypatch.setattr(module, "is_installed", lambda extra: False)
    with pytest.raises(DeviceError, match=r"pip install 'rigd\[pymeasure\]'"):
        asyncio.run(Pymeasure(config, None).open())


@contextmanager
def simulated() -> Iterator[Peer]:
    supply = Supply2260B()
    try:
        yield Peer(
            options={"address": supply.address},
            faults={name: partial(supply.fail, name) for name in FAULTS[:4]},
            observed=lambda: Observed(driven=(supply.driven,), energised=supply.output),
            readings=Voltages(supply.readings),
        )
    finally:
        supply.stop()


@pytest.mark.timeout(900)  # 5 minutes beside a hog on each core
def test_it_keeps_what_a_slow_driver_promises() -> None:
    volts = {"voltage": {**VOLTS["voltage"], "high": "30 V"}}  # the most that it gives
    options = {**SUPPLY, "setpoints": volts, "errors": None}
    report = check_driver(Pymeasure, options, peer=simulated)
    assert report.skipped.keys() == {"action refused", "another at open"}


def test_refused_step_of_safe_hides_no_later_one() -> None:
    class Instrument:
        output_enabled = True

        @property
        def voltage(self) -> float:
            return 5.0

        @voltage.setter
        def voltage(self, value: float) -> None:
            raise ValueError(f"{value} is not in the range [0.1, 30]")

    session = Session({"safe": [["voltage", 0], ["output_enabled", False]], "acted": True})
    session._instrument = instrument = Instrument()
    answer = session.answer({"do": "safe"})
    assert answer["kind"] == "refused" and "0.1, 30" in answer["text"]
    assert not instrument.output_enabled


SWITCH = """
import pathlib, time
from pymeasure.adapters import FakeAdapter
from pymeasure.instruments import Instrument

class Switch(Instrument):
    def __init__(self, address, **options):
        super().__init__(FakeAdapter(), "switch", includeSCPI=False)
        self._file = pathlib.Path(address)

    state = property(lambda self: self._file.read_text().split()[-1])
    level = property(lambda self: 1.0, lambda self, value: None)

    def on(self):
        self._file.write_text("off on")

    def off(self):
        time.sleep(SLOW_S)
        self._file.write_text(self._file.read_text() + " off")
"""


@pytest.fixture
def switch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the options of an instrument that takes longer to switch off than is waited for."""
    (tmp_path / "slow_switch.py").write_text(SWITCH.replace("SLOW_S", str(_END_S + 0.5)))
    (tmp_path / "state").write_text("off")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return {"instrument": "slow_switch.Switch", "address": str(tmp_path / "state")}


def wait_until_off(switch: dict[str, Any]) -> None:
    deadline = time.monotonic() + 30
    while (states := Path(switch["address"]).read_text()) != "off on off":
        assert time.monotonic() < deadline, states
        time.sleep(0.01)


def test_end_lets_a_slow_safe_finish(switch: dict[str, Any]) -> None:
    job = {"visa_library": "", "connection": {}, "timeout_ms": 200, "start": [("on", None)],
           "safe": [("off", None)], "acted": False, **switch}  # fmt: skip

    async def main() -> None:
        process = Process(job, "the switch")
        await process.start()
        await process.ask(OPEN_S, do="open")
        await process.ask(OPEN_S, do="start")
        await process.end()

    asyncio.run(main())
    wait_until_off(switch)


def test_answer_during_stall_of_computer_counts(switch: dict[str, Any]) -> None:
    job = {"visa_library": "", "connection": {}, "timeout_ms": 200, "start": [],
           "safe": [], "acted": False, **switch}  # fmt: skip

    async def main() -> None:
        process = Process(job, "the switch")
        await process.start()
        await process.ask(OPEN_S, do="open")
        asked = asyncio.create_task(process.ask(0.1, do="start"))
        await asyncio.sleep(0.0)
        time.sleep(1.0)  # the event loop does nothing for ten times the limit
        await asked
        await process.end()

    asyncio.run(main())


def test_refused_opening_undoes_start(switch: dict[str, Any]) -> None:
    config = PymeasureConfig.model_validate(
        {**switch, "channels": {"level": {"read": "level", "unit": "V", "high": "0.5 V"}},
         "setpoints": {"level": {"write": "level", "unit": "V", "low": "0 V", "high": "1 V"}},
         "start": "on", "safe": "off", "state": {"read": "state", "safe": "off", "ready": "on"}}
    )  # fmt: skip
    with pytest.raises(ProtocolError, match="beyond the range of level"):
        asyncio.run(Pymeasure(config, None).open())
    wait_until_off(switch)


def test_process_that_stands_still_is_replaced_for_safe() -> None:
    async def scene(driver: Pymeasure, supply: Supply2260B) -> None:
        await armed(driver)
        own = driver._process
        assert own is not None
        assert own._child is not None
        os.kill(own._child.pid, signal.SIGSTOP)
        await driver.make_safe()
        assert not supply.output

    play(scene, timeout="0.5 s")
