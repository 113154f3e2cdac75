"""The driver against a simulated device on a pty: what happens at the bench."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.instruments.lines.config import LinesConfig
from rigd_drivers.instruments.lines.driver import Lines
from rigd_drivers.instruments.lines.tally import LineStatus
from rigd_sim.wire.instruments.lines import SimLines

TIMEOUT_S = 30
#: Options of a device that is asked, and of one that sends by itself.
ASKED = {"ask": r"?\r", "period": "0.03 s", "timeout": "0.2 s"}


class Bench:
    """A device that shows ``values``, its driver, and its rows."""

    def __init__(self, device: SimLines, driver: Lines, values: dict[str, float]) -> None:
        self.device, self.driver, self.values = device, driver, values
        self.rows: list[Sequence[float]] = []
        self._arrived = asyncio.Event()

    def emit(self, row: Sequence[float]) -> None:
        self.rows.append(row)
        self._arrived.set()

    async def until(self, wanted: Callable[[Sequence[float]], bool]) -> Sequence[float]:
        async with asyncio.timeout(TIMEOUT_S):
            while not (self.rows and wanted(self.rows[-1])):
                self._arrived.clear()
                await self._arrived.wait()
        return self.rows[-1]

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        task = asyncio.create_task(self.driver.run(self.emit))
        try:
            yield
        finally:
            task.cancel()
            await asyncio.wait([task])

    async def failure(self) -> DeviceError | LinkError | ProtocolError:
        async with asyncio.timeout(TIMEOUT_S):
            try:
                await self.driver.run(self.emit)
            except (DeviceError, LinkError, ProtocolError) as error:
                return error
        raise AssertionError("run returned")


@contextlib.asynccontextmanager
async def bench(folder: Path, *, asked: bool = True, **options: Any) -> AsyncIterator[Bench]:
    values = {"force": 4.25, "temperature": 20.0}
    device = SimLines(
        "gauge", folder / "gauge", lambda: values, "{force:+.3f} {temperature:.1f}",
        ask="?" if asked else None, interval_s=0.03, identity="ACME,G1,7,1.0",
    )  # fmt: skip
    given = {
        "port": str(folder / "gauge"),
        "columns": ["force", "temperature"],
        "channels": {"force": {"unit": "N", "low": "-50 N", "high": "50 N"}, "temperature": "degC"},
        "silence": "1 s",
    }
    config = LinesConfig.model_validate({**given, **(ASKED if asked else {}), **options})
    driver = Lines(config, None)
    await device.start()
    try:
        yield Bench(device, driver, values)
    finally:
        await driver.close()
        await device.stop()


def sound(row: Sequence[float]) -> bool:
    return row[:2] == pytest.approx((4.25, 293.15)) and int(row[2]) & 0xFFFF == 0


def test_line_between_question_and_identity_is_none() -> None:
    ended = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        writer.write(b"*IDN?\r\n4.25 20.0\r\nACME,G1\r\n4.25 20.0\r\n")
        await reader.read()
        writer.close()
        await writer.wait_closed()
        ended.set()

    async def main() -> None:
        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        options = {
            "port": f"tcp://127.0.0.1:{port}",
            "columns": ["force", "temperature"],
            "channels": {"force": "N", "temperature": "degC"},
            "identify": r"*IDN?\n",
        }
        driver = Lines(LinesConfig.model_validate(options), None)
        await driver.open()
        assert driver.identity == "ACME,G1"
        await driver.close()
        server.close()
        await ended.wait()

    asyncio.run(main())


@pytest.mark.parametrize("asked", [True, False])
def test_values_follow_the_device(asked: bool, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, asked=asked) as found:
            await found.driver.open()
            async with found.running():
                await found.until(sound)
                found.values["force"] = -3.5
                await found.until(lambda row: row[0] == -3.5)

    asyncio.run(main())


def test_lines_before_the_run_are_no_rows(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, asked=False) as found:
            await found.driver.open()
            port = found.driver._port
            before = port.received
            async with asyncio.timeout(TIMEOUT_S):
                while port.received < before + 100:  # meanwhile another device is opened
                    await asyncio.sleep(0.01)
            found.values["force"] = -3.5
            async with found.running():
                await found.until(lambda row: True)
            assert found.rows[0][0] == -3.5

    asyncio.run(main())


def test_identity_start_and_stop_are_sent(tmp_path: Path) -> None:
    async def main() -> None:
        given: dict[str, Any] = {
            "identify": r"*IDN?\n",
            "start": r"ON\r",
            "stop": [r"OFF\r", r"LOCAL\r"],
        }
        async with bench(tmp_path, **given) as found:
            await found.driver.open()
            assert found.driver.identity == "ACME,G1,7,1.0"
            assert found.device.commands == [b"ON"]
            await found.driver.close()
            async with asyncio.timeout(TIMEOUT_S):
                while found.device.commands != [b"ON", b"OFF", b"LOCAL"]:
                    await asyncio.sleep(0.01)

    asyncio.run(main())


@pytest.mark.parametrize("asked", [True, False])
@pytest.mark.parametrize("fault", ["garbage", "partial", "merged", "nul", "short", "comma"])
def test_damaged_line_never_becomes_a_number(asked: bool, fault: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, asked=asked) as found:
            await found.driver.open()
            found.device.inject(
                fault, **({} if fault in ("short", "comma") else {"probability": 0.4})
            )
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(2.5):
                    await found.failure()
            for force, temperature, _ in found.rows:
                assert (force, temperature) == pytest.approx((4.25, 293.15))

    asyncio.run(main())


def test_unreadable_lines_are_counted_in_status(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, asked=False) as found:
            await found.driver.open()
            async with found.running():
                await found.until(sound)
                found.device.inject("word", word="4.2.5")
                await asyncio.sleep(0.2)
                found.device.clear()
                row = await found.until(lambda row: bool(int(row[2]) & LineStatus.UNREADABLE))
                assert 1 <= int(row[2]) >> 16 & 0xFF < 40

    asyncio.run(main())


@pytest.mark.parametrize("fault", ["no_cr", "echo"])
def test_harmless_oddity_is_ridden_through(fault: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.device.inject(fault)
            async with found.running():
                for value in (1.0, 2.0, 3.0):
                    found.values["force"] = value
                    row = await found.until(lambda row, value=value: row[0] == value)  # type: ignore[misc]
                    assert row[2] == 0

    asyncio.run(main())


def test_value_beyond_range_is_marked(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, beyond=["OL"]) as found:
            await found.driver.open()
            found.device.inject("word", word="OL")
            async with found.running():
                row = await found.until(lambda row: math.isnan(row[0]))
                assert int(row[2]) & LineStatus.BEYOND
                assert row[1] == pytest.approx(293.15)

    asyncio.run(main())


@pytest.mark.parametrize("asked", [True, False])
@pytest.mark.parametrize(
    ("fault", "kind", "words"),
    [
        ("silent", LinkError, "nothing comes"),
        ("unplug", DeviceError, "/dev/serial/by-id"),
        ("short", ProtocolError, r"b'\+4.250': it has 1 columns, expected 2"),
        ("word", ProtocolError, r"column 1 \('force'\) is 'OL'"),
        ("comma", ProtocolError, "decimal: comma"),
        ("endless", ProtocolError, "no line of at most 256 bytes"),
    ],
)
def test_lasting_fault_ends_with_its_cause(
    asked: bool, fault: str, kind: type[Exception], words: str, tmp_path: Path
) -> None:
    # An answer that a stall of this machine delays is not the fault.
    patience = {"timeout": "1 s"} if asked else {}

    async def main() -> None:
        async with bench(tmp_path, asked=asked, **patience) as found:
            await found.driver.open()
            found.device.inject(fault)
            error = await found.failure()
            assert isinstance(error, kind), error
            assert error.hint
            assert re.search(words, f"{error.message} {error.hint}"), error

    asyncio.run(main())


def test_silence_after_late_answer_is_named_silence(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, silence="4 s") as found:
            await found.driver.open()
            found.device.inject("late", delay_s=0.5)
            running = asyncio.create_task(found.failure())
            async with asyncio.timeout(TIMEOUT_S):
                while not found.driver._port.late:
                    await asyncio.sleep(0.01)
            found.device.clear()
            before = len(found.rows)
            await found.until(lambda _: len(found.rows) > before + 2)
            found.device.inject("silent")
            error = await running
            assert "nothing comes" in error.message

    asyncio.run(main())


def test_device_that_only_echoes_is_named(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, ask=r"*\r", timeout="2 s", silence="3 s") as found:
            found.device.inject("echo")
            with pytest.raises(ProtocolError, match="returns the question"):
                await found.driver.open()

    asyncio.run(main())


def test_device_that_was_never_on_is_named(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            found.device.inject("silent")
            with pytest.raises(LinkError, match=r"nothing comes from .* to b'\?\\r' for 1 s"):
                await found.driver.open()

    asyncio.run(main())


@pytest.mark.parametrize("delay_s", [0.25, 0.5, 1.1, 1.4])
def test_late_answer_never_shows_an_old_value(delay_s: float, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, silence="3 s") as found:
            await found.driver.open()
            found.device.inject("late", delay_s=delay_s)
            found.values["force"] = 1.0
            task = asyncio.create_task(found.failure())
            await asyncio.sleep(0.1)
            found.rows.clear()
            found.values["force"] = 2.0
            error = await task
            assert [row[0] for row in found.rows if row[0] != 2.0] == []
            assert "later than 0.2 s" in error.message

    asyncio.run(main())


def test_wrong_baud_rate_is_no_number(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, baud=4800) as found:
            with pytest.raises((ProtocolError, LinkError), match=r"4\.25|read|lines|nothing"):
                await found.driver.open()

    asyncio.run(main())
