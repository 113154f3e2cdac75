"""The driver for SCPI at instruments of others and of its own: rows, setpoints, safe, refusals."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from support.faults.stalls import standing_still
from support.instruments.supply_2260b import Voltages
from support.instruments.visa_bridge import Bridge
from support.written_drivers import supply_class

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd.sdk.check import Observed, Peer, check_driver
from rigd.sdk.port import LinePort
from rigd_drivers.instruments.polling import PolledStatus
from rigd_drivers.instruments.scpi.config import ScpiConfig
from rigd_drivers.instruments.scpi.driver import Scpi
from rigd_sim.wire.instruments.oven import SimOven

#: 0 degC in K.
ICE = 273.15
OVEN: dict[str, Any] = {
    "channels": {
        "measured": {"ask": "MEAS:TEMP?", "unit": "degC", "low": "-20 degC", "high": "300 degC"},
        "power": {"ask": "MEAS:POW?", "unit": "%"},
    },
    "setpoints": {
        "temperature": {
            "unit": "degC", "low": "0 degC", "high": "200 degC",
            "write": "SOUR:TEMP {temperature:.2f}", "read": "SOUR:TEMP?", "within": "0.01 K",
        },
    },
    "arm": "OUTP ON",
    "safe": "OUTP OFF",
    "state": {"ask": "OUTP?", "safe": "0", "ready": "1"},
    "period": "0.05 s",
    "timeout": "0.5 s",  # this computer may stall
    "silence": "1 s",
}  # fmt: skip
Scene = Callable[[Scpi, SimOven], Awaitable[None]]


def play(folder: Path, scene: Scene, *, tcp: bool = False, **options: Any) -> None:
    """Play ``scene`` with an open driver at a simulated oven."""

    async def main() -> None:
        oven = SimOven("oven", folder / "oven", port=0 if tcp else None, time_constant_s=0.2)
        await oven.start()
        port = f"tcp://127.0.0.1:{oven.port}" if tcp else str(folder / "oven")
        driver = Scpi(ScpiConfig.model_validate({**OVEN, "port": port, **options}), None)
        try:
            await driver.open()
            await scene(driver, oven)
        finally:
            await driver.close()
            await oven.stop()

    asyncio.run(main())


async def rows_of(driver: Scpi, count: int) -> list[Sequence[float]]:
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


async def armed(driver: Scpi, celsius: float = 80.0) -> None:
    await driver.write([20.0 + ICE])
    await driver.arm()
    await driver.write([celsius + ICE])


@pytest.mark.parametrize("tcp", [False, True], ids=["serial", "tcp"])
def test_oven_is_heated_and_made_safe(tmp_path: Path, tcp: bool) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        assert driver.identity == "rigd,simulated oven,1,1.0"
        await driver.write([20.0 + ICE])
        assert not oven.state()["output"]
        await driver.arm()
        await driver.write([80.0 + ICE])
        assert (oven.state()["output"], oven.state()["set_temperature"]) == (True, 80.0)
        rows = await rows_of(driver, 3)
        assert rows[-1][0] > 21.5 + ICE
        assert 0.0 < rows[0][1] <= 1.0, "percent is a share"
        assert rows[-1][2] == 0
        await driver.make_safe()
        assert not oven.state()["output"]
        await driver.make_safe()

    play(tmp_path, scene, tcp=tcp)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("locked", r"answers '0' to 'OUTP\?', expected '1': its output is not on"),
        ("stuck", r"was given b'SOUR:TEMP 80\.00', and answers 20\.0 to 'SOUR:TEMP\?'"),
        ("setpoint_ignored", r"was given b'SOUR:TEMP 80\.00', and answers 20\.0"),
    ],
)
def test_oven_that_does_not_obey_is_a_fault(tmp_path: Path, fault: str, words: str) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        await driver.write([20.0 + ICE])
        if fault != "locked":
            await driver.arm()
        oven.inject(fault)
        with pytest.raises(DeviceError, match=words):
            await (driver.arm() if fault == "locked" else driver.write([80.0 + ICE]))

    play(tmp_path, scene)


def test_oven_that_stays_on_is_not_safe(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        await armed(driver)
        oven.inject("stuck")
        with pytest.raises(DeviceError, match=r"answers '1' to 'OUTP\?' after OUTP OFF"):
            await driver.make_safe()

    play(tmp_path, scene)


def test_safe_is_sent_while_an_answer_is_due(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        await armed(driver)
        oven.inject("lost")  # obeys, and its answers do not come
        measuring = asyncio.create_task(rows_of(driver, 1))
        await asyncio.sleep(0.05)
        with pytest.raises(LinkError, match=r"does not answer 'OUTP\?'"):
            await driver.make_safe()
        assert not oven.state()["output"]
        measuring.cancel()
        await asyncio.wait({measuring})

    play(tmp_path, scene)


def test_safe_goes_over_a_new_connection(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        await armed(driver)
        oven.inject("unplug")
        await asyncio.sleep(0.05)
        oven.clear("unplug")
        assert oven.state()["output"]
        await driver.make_safe()
        assert not oven.state()["output"]

    play(tmp_path, scene)


def test_unplugged_oven_is_not_reported_safe(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        await armed(driver)
        oven.inject("unplug")
        with pytest.raises((LinkError, DeviceError)):
            await driver.make_safe()

    play(tmp_path, scene)


def test_error_of_queue_ends_the_rows(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        await armed(driver)
        oven.inject("tripped")
        with pytest.raises(DeviceError, match=r"reports 101 'Over-temperature protection' when it"):
            await rows_of(driver, 1000)

    play(tmp_path, scene)


def test_output_that_goes_off_is_a_fault(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        await armed(driver)
        oven.inject("locked")
        with pytest.raises(DeviceError, match="its output is not on any more"):
            await rows_of(driver, 1000)

    play(tmp_path, scene)


def test_output_on_after_a_stall_is_armed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        get, stall = driver._get, standing_still(monkeypatch)
        before = ["0"]

        async def stalling(question: str) -> str:
            if before:  # what it answered before this computer stood still
                stall()
                return before.pop()
            return await get(question)

        monkeypatch.setattr(driver, "_get", stalling)
        await driver.write([20.0 + ICE])
        await driver.arm()
        assert oven.state()["output"]

    play(tmp_path, scene, errors=None)


def test_output_off_by_make_safe_is_no_fault(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        async def check() -> None:
            async with driver._sequence:
                await driver._check_output()

        await armed(driver)
        checking = asyncio.create_task(check())
        await asyncio.sleep(0)  # it is about to ask
        await driver.make_safe()
        assert not oven.state()["output"]
        await checking

    play(tmp_path, scene)


def test_refused_setpoint_is_named_with_its_error(tmp_path: Path) -> None:
    high = {**OVEN["setpoints"]["temperature"], "high": "400 degC"}

    async def scene(driver: Scpi, oven: SimOven) -> None:
        with pytest.raises(DeviceError, match=r"-222 'Data out of range' when temperature is set"):
            await driver.write([350.0 + ICE])

    play(tmp_path, scene, setpoints={"temperature": high})


def test_refused_setpoint_after_lost_answer_is_named(tmp_path: Path) -> None:
    high = {**OVEN["setpoints"]["temperature"], "high": "400 degC"}

    async def scene(driver: Scpi, oven: SimOven) -> None:
        oven.inject("lost")
        assert isinstance(await driver._take(), LinkError)
        oven.clear("lost")
        with pytest.raises(DeviceError, match=r"-222 'Data out of range' when temperature is set"):
            await driver.write([350.0 + ICE])

    del high["read"], high["within"]
    play(tmp_path, scene, setpoints={"temperature": high})


def test_infinite_reading_is_nan_with_its_bit(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        oven.inject("broken_wire")
        (row, *_) = await rows_of(driver, 1)
        assert math.isnan(row[0])
        assert row[-1] == PolledStatus.BEYOND

    play(tmp_path, scene)


def test_lost_answers_leave_out_rows_only(tmp_path: Path) -> None:
    async def scene(driver: Scpi, oven: SimOven) -> None:
        before = await rows_of(driver, 1)
        assert before[0][-1] == 0
        oven.inject("lost")
        task = asyncio.create_task(rows_of(driver, 1))
        await asyncio.sleep(0.3)
        oven.clear("lost")
        (row, *_) = await task
        assert row[-1] == PolledStatus.INCOMPLETE

    play(tmp_path, scene)


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"model": "E36103B"}, ProtocolError, "which has no 'E36103B'"),
        ({"errors": "*IDN?"}, ProtocolError, r"answers 'rigd,.*' to '\*IDN\?'"),
        ({"start": "HELLO"}, DeviceError, "-113 'Undefined header' when it is opened"),
        ({"identify": "WHO?"}, LinkError, r"does not answer 'WHO\?' within 0\.5 s"),
    ],
)
def test_other_instrument_is_refused(
    tmp_path: Path, options: dict[str, Any], kind: type[Exception], words: str
) -> None:
    async def never(driver: Scpi, oven: SimOven) -> None:
        raise AssertionError("it is open")

    with pytest.raises(kind, match=words):
        play(tmp_path, never, **options)


def test_wrong_question_is_shown_with_its_answer(tmp_path: Path) -> None:
    channels = {"measured": {"ask": "*IDN?", "unit": "degC"}}

    async def scene(driver: Scpi, oven: SimOven) -> None:
        with pytest.raises(ProtocolError, match=r"to '\*IDN\?', which is no number, for 1 s"):
            await rows_of(driver, 1)

    play(tmp_path, scene, channels=channels)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"safe": ()}, "'safe' is needed"),
        ({"state": None}, "'state' is needed"),
        ({"setpoints": {}}, "'arm' is for an instrument with setpoints"),
        ({"setpoints": {"temperature": {**OVEN["setpoints"]["temperature"], "write": "TEMP"}}},
         "must have {temperature} in braces"),
        ({"setpoints": {"temperature": {**OVEN["setpoints"]["temperature"], "within": "0 K"}}},
         "must be above 0"),
        ({"setpoints": {"temperature": {**OVEN["setpoints"]["temperature"], "within": "1 V"}}},
         "is in V, expected K"),
        ({"setpoints": {"temperature": OVEN["setpoints"]["temperature"] | {"within": "1 degC"}}},
         "a difference is expected"),
        ({"end": "\\q"}, "is no escape"),
        ({"channels": {}}, "at least 1"),
    ],
)  # fmt: skip
def test_wrong_description_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ScpiConfig.model_validate({**OVEN, "port": "tcp://oven:5025", **change})


FAULTS = ("dead", "silent", "late", "garbled")
SUPPLY = {
    "channels": {
        "voltage": {"ask": "MEAS:VOLT?", "unit": "V", "low": "-1 V", "high": "33 V"},
        "current": {"ask": "MEAS:CURR?", "unit": "A", "low": "-5 A", "high": "5 A"},
    },
    "setpoints": {"voltage": {"unit": "V", "low": "0 V", "high": "30 V",
                              "write": "VOLT {voltage:.4f}"}},
    "arm": "OUTP ON",
    "safe": ["OUTP OFF", "VOLT 0"],
    "state": {"ask": "OUTP?", "safe": "0", "ready": "1"},
    "period": "0.05 s",
    "silence": "1 s",
    "timeout": "0.5 s",  # this computer may stall
}  # fmt: skip


@pytest.mark.parametrize(
    ("sent", "delay_s", "options"),
    [
        (b"MEAS:TEMP?\n", 0.3, {}),
        (b"HELLO\n", 0.0, {"start": ()}),
        (b"OUTP?\n", 0.0, {"identify": "WHO?"}),
    ],
    ids=["late answer", "error in queue", "no identity"],
)
def test_rescue_sends_safe_before_any_question(
    tmp_path: Path, sent: bytes, delay_s: float, options: dict[str, Any]
) -> None:
    async def main() -> None:
        oven = SimOven("oven", tmp_path / "oven")
        await oven.start()
        config = ScpiConfig.model_validate(
            {**OVEN, "port": str(tmp_path / "oven"), "timeout": "0.5 s", **options}
        )
        oven.inject("late", delay_s=delay_s)
        killed = LinePort(config)
        await killed.open()
        killed.send(b"OUTP ON\n" + sent)
        await asyncio.sleep(0.05)
        killed.close()
        assert oven.state()["output"]
        try:
            await Scpi(config, None).rescue()
            assert not oven.state()["output"]
        finally:
            await oven.stop()

    asyncio.run(main())


@contextmanager
def simulated() -> Iterator[Peer]:
    """Serve a supply with SCPI, which is written apart, over TCP."""
    device = supply_class()()
    try:
        yield Peer(
            options={"port": device.port},
            faults={name: partial(device.fail, name) for name in FAULTS},
            observed=Observed,
            readings=Voltages(device.readings),
            vary=device.vary,
        )
    finally:
        device.stop()


def test_it_keeps_what_a_slow_driver_promises() -> None:
    report = check_driver(Scpi, SUPPLY, peer=simulated)
    assert report.skipped.keys() == {"action refused", "another at open"}


def visa(resource: str, scene: Callable[[Scpi], Awaitable[None]], **options: Any) -> None:
    bridge = Bridge(resource)
    config = ScpiConfig.model_validate({
        "port": bridge.port, "end": r"\r\n", "start": (), "period": "0.05 s", "silence": "1 s",
        "channels": {"voltage": {"ask": ":VOLT:IMM:AMPL?", "unit": "V"}}, **options,
    })  # fmt: skip

    async def main() -> None:
        driver = Scpi(config, None)
        try:
            await driver.open()
            await scene(driver)
        finally:
            await driver.close()

    try:
        asyncio.run(main())
    finally:
        bridge.close()


VISA_SETPOINT = {
    "unit": "V", "low": "1 V", "high": "6 V", "write": ":VOLT:IMM:AMPL {voltage:.3f}",
    "read": ":VOLT:IMM:AMPL?", "within": "1 mV",
}  # fmt: skip


def test_supply_of_another_author_is_set_and_safe() -> None:
    async def scene(driver: Scpi) -> None:
        assert driver.identity == "SCPI,MOCK,VERSION_1.0"
        await driver.write([1.0])
        await driver.arm()
        await driver.write([3.25])
        rows = await rows_of(driver, 3)
        assert [tuple(row) for row in rows] == [(3.25, 0)] * 3
        await driver.make_safe()

    visa(
        "ASRL2::INSTR", scene, model="MOCK", errors="*ESR?",
        setpoints={"voltage": VISA_SETPOINT}, arm="OUTP 1", safe="OUTP 0",
        state={"ask": "OUTP?", "safe": "0", "ready": "1"},
    )  # fmt: skip


def test_error_queue_of_another_author_is_read() -> None:
    async def scene(driver: Scpi) -> None:
        assert [tuple(row) for row in await rows_of(driver, 2)] == [(1.0, 0)] * 2

    visa("ASRL4::INSTR", scene, errors=":SYST:ERR?")
    with pytest.raises(DeviceError, match="reports 1 'Command error' when it is opened"):
        visa("ASRL4::INSTR", scene, errors=":SYST:ERR?", start="HELLO")
