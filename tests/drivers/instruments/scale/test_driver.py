"""The driver against a simulated scale on a pty: what an operator can meet at the bench."""

from __future__ import annotations

import asyncio
import contextlib
import math
import termios
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.instruments.scale import driver as module
from rigd_drivers.instruments.scale.driver import ScaleConfig, ScaleStatus, SerialScale
from rigd_drivers.instruments.scale.replies import Reading
from rigd_sim.wire.instruments.scale import SimScale
from rigd_sim.wire.instruments.scale_languages import STABILITY_S, AndD

DIALECTS = ("mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi", "ohaus")
TIMEOUT_S = 20


@dataclass
class Rows:
    """Takes rows, and lets a test wait for one."""

    rows: list[Sequence[float]] = field(default_factory=list)
    _arrived: asyncio.Event = field(default_factory=asyncio.Event)

    def __call__(self, row: Sequence[float]) -> None:
        self.rows.append(row)
        self._arrived.set()

    async def until(self, wanted: Callable[[Sequence[float]], bool]) -> Sequence[float]:
        async with asyncio.timeout(TIMEOUT_S):
            while True:
                if self.rows and wanted(self.rows[-1]):
                    return self.rows[-1]
                self._arrived.clear()
                await self._arrived.wait()


@dataclass
class Bench:
    """A simulated scale and the driver that reads it."""

    scale: SimScale
    driver: SerialScale
    load_kg: list[float]
    rows: Rows = field(default_factory=Rows)

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[asyncio.Task[None]]:
        task = asyncio.create_task(self.driver.run(self.rows))
        try:
            yield task
        finally:
            task.cancel()
            await asyncio.wait([task])

    async def failure(self) -> DeviceError | ProtocolError | LinkError:
        """Run until the driver gives up, and return how."""
        async with asyncio.timeout(TIMEOUT_S):
            try:
                await self.driver.run(self.rows)
            except (DeviceError, ProtocolError, LinkError) as error:
                return error
        raise AssertionError("run returned")


@contextlib.asynccontextmanager
async def bench(
    folder: Path, dialect: Any = "mt-sics", *, unit: str = "kg", shows: Any = "kg", baud: int = 9600
) -> AsyncIterator[Bench]:
    load = [2.0]
    port = folder / "scale"
    scale = SimScale(
        "scale", port, lambda: load[0], dialect=dialect, unit=shows, settling_s=0.02
    )  # fmt: skip
    config = ScaleConfig.model_validate(
        {"port": str(port), "dialect": dialect, "unit": unit, "baud": baud, "interval": "0.11 s"}
    )
    driver = SerialScale(config, None)
    await scale.start()
    try:
        yield Bench(scale, driver, load)
    finally:
        await driver.close()
        await scale.stop()


def near(mass: float) -> Callable[[Sequence[float]], bool]:
    def wanted(row: Sequence[float]) -> bool:
        return abs(row[0] - mass) < 0.005 and bool(int(row[1]) & ScaleStatus.STABLE)

    return wanted


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_load_is_weighed_tared_and_zeroed(dialect: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, dialect) as found:
            await found.driver.open()
            asked = dialect in DIALECTS[:3]  # the others know no question for it
            assert ("B021002593" in found.driver.identity) is asked
            async with found.running():
                await found.rows.until(near(2.0))
                found.load_kg[0] = 5.0
                await found.rows.until(near(5.0))
                said = await found.driver.act("tare")
                assert said == ("tare 5.000 kg" if dialect in DIALECTS[:2] else "tare done")
                await found.rows.until(near(0.0))
                found.load_kg[0] = 6.0
                await found.rows.until(near(1.0))
                found.load_kg[0] = 0.01
                await found.rows.until(near(-4.99))
                assert await found.driver.act("zero") == "zero done"
                await found.rows.until(near(0.0))

    asyncio.run(main())


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize(
    ("fault", "bit"), [("overload", ScaleStatus.OVERLOAD), ("underload", ScaleStatus.UNDERLOAD)]
)
def test_beyond_its_range_the_mass_is_nan(
    dialect: str,
    fault: str,
    bit: ScaleStatus,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "REST_S", 0.3)

    async def main() -> None:
        async with bench(tmp_path, dialect) as found:
            await found.driver.open()
            async with found.running():
                found.scale.inject(fault)
                row = await found.rows.until(lambda row: int(row[1]) == bit)
                assert math.isnan(row[0])
                with pytest.raises(DeviceError, match=r"did not come to rest|cannot"):
                    await found.driver.act("tare")
                found.scale.clear()
                await found.rows.until(near(2.0))

    asyncio.run(main())


@pytest.mark.parametrize("dialect", DIALECTS)
def test_tare_outlives_session_and_set_at_keypad_too(dialect: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, dialect) as found:
            found.scale.weighing.tare_kg = 1.5
            for _ in range(2):
                await found.driver.open()
                async with found.running():
                    await found.rows.until(near(0.5))
                await found.driver.close()
            assert found.scale.weighing.tare_kg == 1.5

    asyncio.run(main())


def test_late_answer_is_never_taken_for_next_question(tmp_path: Path) -> None:
    """The load changes between two answers; each row has what the scale showed as it was asked."""

    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.scale.inject("late", delay_s=module.REPLY_S + 0.2)
            asking = asyncio.create_task(found.driver._patient_reading())
            await asyncio.sleep(module.REPLY_S / 2)  # it has been asked, with 2 kg on it
            found.load_kg[0] = 5.0
            await asyncio.sleep(module.REPLY_S / 2 + 0.1)  # given up; the answer is on its way
            found.scale.clear("late")
            reading = await asking
            assert reading.value == pytest.approx(5.0, abs=0.01)

    asyncio.run(main())


def test_scale_that_always_answers_late_is_named(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.scale.inject("late", delay_s=module.REPLY_S + 0.3)
            with pytest.raises(DeviceError, match="answers later than"):
                raise await found.failure()

    asyncio.run(main())


@pytest.mark.parametrize("dialect", DIALECTS[:3])
def test_a_stream_left_on_is_ended(dialect: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, dialect) as found:
            found.scale.inject("stream")
            await found.driver.open()
            assert found.scale.state()["streaming"] is False
            async with found.running():
                await found.rows.until(near(2.0))

    asyncio.run(main())


def test_closing_leaves_the_scale_quiet(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.scale.inject("stream")
            await found.driver.close()
            await found.driver.close()
            async with asyncio.timeout(TIMEOUT_S):
                while found.scale.state()["streaming"]:
                    await asyncio.sleep(0)

    asyncio.run(main())


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_scale_in_pounds_is_refused(dialect: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, dialect, shows="lb") as found:
            with pytest.raises(DeviceError, match="shows lb, the rig expects kg") as caught:
                await found.driver.open()
            assert "press UNIT" in str(caught.value)
            assert "unit: lb" in str(caught.value)

    asyncio.run(main())


def test_unit_changed_at_keypad_ends_run(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.scale.inject("unit", unit="lb")
            assert "shows lb" in str(await found.failure())
            assert found.rows.rows == []  # no pound was taken for a kilogram

    asyncio.run(main())


@pytest.mark.parametrize(
    ("unit", "factor", "channel"),
    [("g", 1, "mass"), ("lb", 1, "mass"), ("oz", 1, "mass"), ("N", 9.80665, "force")],
)
def test_every_unit_becomes_si(unit: str, factor: float, channel: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, unit=unit, shows=unit) as found:
            assert found.driver.declaration.channels[0].name == channel
            await found.driver.open()
            async with found.running():
                await found.rows.until(lambda row: abs(row[0] - 2.0 * factor) < 0.01)

    asyncio.run(main())


@pytest.mark.parametrize(
    "fault", ["garbage", "nul", "partial", "merged", "no_cr", "echo", "lost", "late"]
)
def test_occasional_bad_line_costs_at_most_one_row(fault: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.scale.inject(fault, probability=0.3)
            async with found.running():
                for _ in range(8):
                    found.rows.rows.clear()
                    await found.rows.until(near(2.0))

    asyncio.run(main())


@pytest.mark.parametrize(
    ("fault", "kind", "words"),
    [
        ("silent", LinkError, "nothing answers"),
        ("garbage", ProtocolError, "no weight in|no line that can be read"),
        ("partial", ProtocolError, "no weight in|no line that can be read"),
        ("syntax", DeviceError, "'ES'"),
        ("transmission", DeviceError, "'ET'"),
        ("logic", DeviceError, "'EL'"),
        ("busy", DeviceError, "'S I'"),
        ("unplug", DeviceError, "/dev/serial/by-id"),
    ],
)
def test_lasting_scale_fault_ends_run_with_cause(
    fault: str,
    kind: type[Exception],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "GIVE_UP_S", 0.5)

    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.scale.inject(fault)
            error = await found.failure()
            assert isinstance(error, kind)
            with pytest.raises(kind, match=words):
                raise error

    asyncio.run(main())


def test_scale_plugged_in_again_can_be_opened(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            found.scale.inject("unplug")
            await found.failure()
            await found.driver.close()
            with pytest.raises(LinkError, match="there is no serial port"):
                await found.driver.open()
            found.scale.clear()
            await found.driver.open()
            async with found.running():
                await found.rows.until(near(2.0))

    asyncio.run(main())


def test_moving_load_is_not_tared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "REST_S", 0.3)

    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            async with found.running():
                found.scale.inject("never_stable")
                with pytest.raises(DeviceError, match=r"did not come to rest within 0\.3 s"):
                    await found.driver.act("tare")
                assert found.scale.weighing.tare_kg == 0.0
                found.rows.rows.clear()
                await found.rows.until(lambda row: row[1] == 0)  # rows go on, marked as moving

    asyncio.run(main())


def test_abandoned_tare_is_cancelled_at_scale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The load moves between the reading that was stable and the command: the scale waits."""
    monkeypatch.setattr(module, "ACTION_S", 0.3)

    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            answer = found.scale._language.answer

            def disturbed(command: bytes, now_s: float) -> list[bytes]:
                found.scale.weighing.never_stable |= command == b"T"
                return answer(command, now_s)

            monkeypatch.setattr(found.scale._language, "answer", disturbed)
            with pytest.raises(DeviceError, match=r"did not tare within 0\.3 s"):
                await found.driver.act("tare")
            async with asyncio.timeout(STABILITY_S / 2):  # long before it would give up by itself
                while found.scale._language._waiting is not None:
                    await asyncio.sleep(0)
            assert found.scale.weighing.tare_kg == 0.0

    asyncio.run(main())


def test_tare_behind_a_lost_reading_is_sent_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reading of the run is lost between the one that was stable and the command."""
    monkeypatch.setattr(module, "REPLY_S", 0.3)

    async def main() -> None:
        async with bench(tmp_path) as found:
            driver, language = found.driver, found.scale._language
            heard: list[bytes] = []
            lost: list[list[bytes]] = []
            rest, answer = driver._rest, language.answer

            def answered(command: bytes, now_s: float) -> list[bytes]:
                heard.append(command)
                return lost.pop() if lost else answer(command, now_s)

            async def rest_and_read(action: str) -> Reading:
                reading = await rest(action)
                lost.append([])
                read = driver._dialect.read, driver._dialect.parse_reading
                assert await driver._exchange(*read, module.REPLY_S) is None
                return reading

            await driver.open()
            monkeypatch.setattr(language, "answer", answered)
            monkeypatch.setattr(driver, "_rest", rest_and_read)
            assert await driver.act("tare") == "tare 2.000 kg"
            assert heard.count(b"T") == 1

    asyncio.run(main())


def test_a_zero_with_a_load_on_is_refused(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            async with found.running():
                with pytest.raises(DeviceError, match=r"refuses to zero: Z \+"):
                    await found.driver.act("zero")
                with pytest.raises(ValueError, match="no action 'fly'"):
                    await found.driver.act("fly")

    asyncio.run(main())


def test_and_scale_with_error_codes_explains_its_refusal(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, "and-d") as found:
            language = found.scale._language
            assert isinstance(language, AndD)
            language.error_codes = True
            await found.driver.open()
            async with found.running():
                with pytest.raises(DeviceError, match="refuses to zero: EC,E17"):
                    await found.driver.act("zero")
                assert await found.driver.act("tare") == "tare done"
                await found.rows.until(near(0.0))

    asyncio.run(main())


def test_adapter_reports_settings_that_it_cannot_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What glibc makes of a parity that the hardware ignores: EINVAL."""

    def refuse(*_: object) -> None:
        raise termios.error(22, "Invalid argument")

    async def main() -> None:
        async with bench(tmp_path) as found:
            monkeypatch.setattr(termios, "tcsetattr", refuse)
            with pytest.raises(LinkError, match="cannot be set to 9600 baud, 8 data bits"):
                await found.driver.open()
            monkeypatch.undo()

    asyncio.run(main())


def test_wrong_baud_rate_is_named_at_opening(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path, baud=19200) as found:
            with pytest.raises(ProtocolError, match="baud"):
                await found.driver.open()

    asyncio.run(main())


def test_silent_scale_error_names_what_to_check(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            found.scale.inject("silent")
            with pytest.raises(LinkError, match="nothing answers") as caught:
                await found.driver.open()
            assert "is the scale on" in str(caught.value)
            found.scale.clear()
            await found.driver.open()

    asyncio.run(main())


def test_a_port_belongs_to_one_program(tmp_path: Path) -> None:
    async def main() -> None:
        async with bench(tmp_path) as found:
            await found.driver.open()
            second = SerialScale(found.driver.config, None)
            with pytest.raises(LinkError, match="another program holds"):
                await second.open()
            with pytest.raises(LinkError, match="is open already"):
                await found.driver.open()
            async with found.running():  # and stays open
                await found.rows.until(near(2.0))

    asyncio.run(main())


def test_kern_is_not_asked_faster_than_it_allows() -> None:
    options = {"port": "/dev/ttyUSB0", "dialect": "kern-kcp", "interval": "0.05 s"}
    with pytest.raises(ValidationError, match="more than"):
        ScaleConfig.model_validate(options)
    assert ScaleConfig.model_validate({**options, "dialect": "mt-sics"}).interval == 0.05


def test_baud_rate_and_data_bits_parse_as_written() -> None:
    config = ScaleConfig.model_validate(
        {"port": "/dev/ttyS0", "dialect": "and-d", "baud": "2400", "data_bits": "7"}
    )
    assert (config.baud, config.data_bits) == (2400, 7)
