"""The relay driver with the unmodified nidaqmx package, against the simulated device server."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
from pydantic import ValidationError
from support.cards.served import served
from support.faults.stalls import standing_still, witnessed

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd.sdk.check import Observed, Peer, background_loop, check_driver
from rigd_drivers.cards.ni_relay import NiRelay
from rigd_drivers.cards.ni_relay.config import NiRelayConfig
from rigd_drivers.cards.ni_relay.driver import ARMED, LIMITED, ONE_SHOT, PENDING
from rigd_drivers.cards.ni_relay.keeper import CYCLE_SILENCE_S
from rigd_sim.wire.cards.analog_drives import OneShot
from rigd_sim.wire.cards.ni import SimNi
from rigd_sim.wire.cards.ni_lines import Lines

ONE_SHOT_S = 0.3
WATCHDOG = {"line": "port0/line1", "feedback": "port0/line2", "time": f"{ONE_SHOT_S} s"}
WAIT_S = 30.0


class Bench:
    """A card with a relay that closes on low, a one-shot in series, and a record of it all."""

    def __init__(self, one_shot_s: float = 0.9 * ONE_SHOT_S) -> None:
        self.one_shot_s = one_shot_s
        self.one_shot = OneShot(one_shot_s, time.monotonic_ns)
        self.line: list[tuple[int, bool]] = []  #: when, and whether the line closes the relay
        self.edges: list[int] = []
        lines = Lines(
            {"port0/line2": lambda: self.one_shot.up},
            {"port0/line0": self._relay, "port0/line1": self._trigger},
        )
        self.part = SimNi("daq", {}, lines=lines)

    def _relay(self, high: bool) -> None:
        self.line.append((time.monotonic_ns(), not high))

    def _trigger(self, high: bool) -> None:
        self.edges.append(time.monotonic_ns())
        self.one_shot.trigger(level=high)

    @property
    def closed(self) -> bool:
        """Whether current flows through the relay."""
        return self.line[-1][1] and self.one_shot.up

    def observed(self) -> Observed:
        """Return what check_driver compares with the driver."""
        watchdog_s = CYCLE_SILENCE_S + self.one_shot_s
        return Observed((float(self.closed),), self.closed, watchdog_s=watchdog_s)


@dataclass
class Rig:
    """The card served, and drivers of it."""

    bench: Bench
    on_loop: Callable[[Callable[[], Any]], Any]
    drivers: list[NiRelay] = field(default_factory=list)

    def make(self, **options: Any) -> NiRelay:
        server = f"127.0.0.1:{self.bench.part.port}"
        given = {"server": server, "watchdog": WATCHDOG, **options}
        driver = NiRelay(NiRelayConfig.model_validate(given))
        self.drivers.append(driver)
        return driver

    def opened(self, **options: Any) -> NiRelay:
        driver = self.make(**options)
        driver.open()
        return driver

    def inject(self, fault: str, **options: Any) -> None:
        self.on_loop(lambda: self.bench.part.inject(fault, **options))


@pytest.fixture
def rig() -> Iterator[Rig]:
    bench = Bench()
    with served(bench.part) as on_loop:
        found = Rig(bench, on_loop)
        yield found
        for driver in found.drivers:
            driver.close()


def cycles(driver: NiRelay, closed: float, until: Callable[[], object]) -> None:
    """Cycle ``driver`` at some 500 Hz until something holds."""
    deadline = time.monotonic() + WAIT_S
    while not until():
        assert time.monotonic() < deadline
        driver.read(time.monotonic_ns())
        driver.write((closed,))
        time.sleep(0.002)


def wait(until: Callable[[], object]) -> None:
    """Wait without a cycle until something holds."""
    deadline = time.monotonic() + WAIT_S
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def armed(driver: NiRelay) -> NiRelay:
    driver.arm()
    cycles(driver, 0.0, driver.ready)
    return driver


def row(driver: NiRelay) -> tuple[float, float, int]:
    """The next row that is not stale."""
    deadline = time.monotonic() + WAIT_S
    while (given := driver.read(time.monotonic_ns())) is None:
        assert time.monotonic() < deadline
        time.sleep(0.002)
    closed, latency, status = given
    return closed, latency, int(status)


def test_relay_closes_and_opens_and_reports_the_duration(rig: Rig) -> None:
    driver = armed(rig.opened())
    assert driver.identity == (
        "USB-6009, serial number 01C0FFEE, NI-DAQmx 24.5.0, relay on port0/line0"
    )
    assert not rig.bench.closed
    wished_ns = time.monotonic_ns()
    cycles(driver, 1.0, lambda: row(driver)[0] == 1.0)
    confirmed_ns = time.monotonic_ns()
    assert rig.bench.closed
    _, latency, status = row(driver)
    assert status & (ARMED | ONE_SHOT | PENDING | LIMITED) == ARMED | ONE_SHOT
    # The line changed after the wish, and before it was confirmed.
    at_ns = rig.bench.line[-1][0]
    assert wished_ns < at_ns < confirmed_ns
    assert (at_ns - wished_ns) * 1e-9 - 0.01 < latency < (confirmed_ns - wished_ns) * 1e-9
    cycles(driver, 0.0, lambda: row(driver)[0] == 0.0)
    assert not rig.bench.closed


def test_request_is_pending_until_card_confirms(rig: Rig) -> None:
    driver = armed(rig.opened(watchdog=None))
    rig.inject("stall", seconds=0.1)
    driver.write((1.0,))
    assert row(driver)[2] & PENDING
    assert row(driver)[0] == 0.0
    cycles(driver, 1.0, lambda: row(driver)[0] == 1.0)
    assert not row(driver)[2] & PENDING
    assert row(driver)[1] >= 0.1


def test_newest_of_many_relay_requests_is_sent(rig: Rig) -> None:
    driver = armed(rig.opened(watchdog=None))
    rig.inject("stall", seconds=0.1)
    before = len(rig.bench.line)
    for count in range(101):
        driver.write((float(count % 2 == 0),))
    rig.on_loop(lambda: rig.bench.part.clear("stall"))
    cycles(driver, 1.0, lambda: not row(driver)[2] & PENDING)
    assert rig.bench.line[-1][1]
    assert len(rig.bench.line) - before <= 3  # what was under way, and the newest


def test_unarmed_relay_ignores_setpoints_and_feeds_no_watchdog(rig: Rig) -> None:
    driver = rig.opened()
    before = len(rig.bench.edges)
    end = time.monotonic() + 0.3
    cycles(driver, 1.0, lambda: time.monotonic() > end)
    assert row(driver)[0] == 0.0
    assert not rig.bench.line[-1][1]
    assert len(rig.bench.edges) == before


def test_nan_is_refused_and_setpoint_before_it_holds(rig: Rig) -> None:
    driver = armed(rig.opened())
    cycles(driver, 1.0, lambda: row(driver)[0] == 1.0)
    with pytest.raises(DeviceError, match="NaN; expected 0 or 1"):
        driver.write((math.nan,))
    assert row(driver)[0] == 1.0


def test_the_watchdog_is_proven_by_silence(rig: Rig) -> None:
    driver = rig.opened()
    assert driver.watchdog_s == pytest.approx(0.1 + ONE_SHOT_S)
    took_s = driver.prove_watchdog()
    assert took_s > 0.9 * ONE_SHOT_S
    assert not rig.bench.one_shot.up
    assert not any(closed for _, closed in rig.bench.line[1:])  # it never moved


def test_a_one_shot_that_stays_up_is_found(rig: Rig) -> None:
    driver = rig.opened()
    rig.bench.one_shot.dead = True
    with pytest.raises(DeviceError, match=r"still up .* expected at most 0\.3 s") as caught:
        driver.prove_watchdog()
    assert "nothing would open the relay" in str(caught.value.hint)


def test_one_shot_that_stays_down_is_found(rig: Rig) -> None:
    driver = rig.opened(watchdog={**WATCHDOG, "line": "port0/line5"})
    with pytest.raises(DeviceError, match=r"not come up .*port0/line5"):
        driver.prove_watchdog()


def test_without_one_shot_there_is_nothing_to_prove(rig: Rig) -> None:
    driver = rig.opened(watchdog=None)
    assert driver.watchdog_s is None
    with pytest.raises(DeviceError, match="no one-shot is declared"):
        driver.prove_watchdog()


def test_cycle_that_falls_silent_starves_one_shot(rig: Rig) -> None:
    driver = armed(rig.opened())
    cycles(driver, 1.0, lambda: rig.bench.closed)
    with witnessed() as lost_s:
        silent = time.monotonic()
        while rig.bench.closed:
            assert time.monotonic() < silent + WAIT_S
            time.sleep(0.005)
        assert rig.bench.line[-1][1]  # by the one-shot alone: the line still closes
        assert rig.bench.edges[-1] * 1e-9 < silent + 0.1 + 0.2 + lost_s()
    with pytest.raises(DeviceError, match="one-shot dropped"):
        cycles(driver, 1.0, lambda: False)


def test_drop_between_two_reads_is_reported(rig: Rig) -> None:
    driver = armed(rig.opened())
    cycles(driver, 1.0, lambda: rig.bench.closed)
    wait(lambda: not rig.bench.closed)  # no cycle feeds it
    raised = time.monotonic_ns()

    def up_for_long() -> bool:
        driver.write((1.0,))
        return rig.bench.one_shot.up and rig.bench.edges[-1] - raised > 0.2e9

    wait(up_for_long)
    with pytest.raises(DeviceError, match="one-shot dropped"):
        driver.read(time.monotonic_ns())


def test_a_slow_one_shot_makes_no_stale_rows(rig: Rig) -> None:
    driver = rig.opened(watchdog={**WATCHDOG, "time": "1 s"})
    row(driver)
    given = []
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        given.append(driver.read(time.monotonic_ns()) is not None)
        time.sleep(0.002)
    assert sum(given) > 0.9 * len(given)


def test_make_safe_opens_and_lets_one_shot_drop(rig: Rig) -> None:
    driver = armed(rig.opened())
    cycles(driver, 1.0, lambda: rig.bench.closed)
    driver.make_safe()
    driver.confirm_safe()
    assert not rig.bench.line[-1][1]
    edges = len(rig.bench.edges)
    cycles(driver, 1.0, lambda: not rig.bench.one_shot.up)  # ignores everything
    assert len(rig.bench.edges) == edges
    assert not rig.bench.line[-1][1]
    driver.make_safe()
    armed(driver)


def test_relay_opened_during_stall_is_safe(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = armed(rig.opened())
    cycles(driver, 1.0, lambda: rig.bench.closed)
    rig.inject("stall", seconds=0.05)
    driver.make_safe()
    stalls, ours = [standing_still(monkeypatch)], threading.current_thread()

    def stalling(clock: Callable[[], float]) -> Callable[[], float]:
        """Return ``clock``; behind the first reading of the thread that waits we stand still."""

        def read() -> float:
            now = clock()
            if threading.current_thread() is ours and stalls:
                stalls.pop()()
            return now

        return read

    for name in ("monotonic", "monotonic_ns"):
        monkeypatch.setattr(time, name, stalling(getattr(time, name)))
    driver.confirm_safe()
    assert not rig.bench.line[-1][1]
    assert not stalls


def test_armed_while_one_shot_drops_comes_up_anew(rig: Rig) -> None:
    driver = armed(rig.opened())
    driver.make_safe()
    driver.arm()  # it is up still, by the pulses before

    def down() -> bool:
        driver.read(time.monotonic_ns())
        return not rig.bench.one_shot.up

    wait(down)
    assert not driver.ready()
    cycles(driver, 0.0, driver.ready)
    cycles(driver, 1.0, lambda: rig.bench.closed)


def test_hanging_server_does_not_delay_other_devices(rig: Rig) -> None:
    driver = armed(rig.opened())
    cycles(driver, 1.0, lambda: rig.bench.closed)
    rig.inject("stall", seconds=3600)
    driver.make_safe()  # the devices behind it are ordered next
    with pytest.raises(LinkError, match=r"did not confirm within 0\.5 s|switch a line"):
        driver.confirm_safe()


def test_dead_server_is_reported_and_make_safe_ends(rig: Rig) -> None:
    bench = Bench()
    with served(bench.part):
        driver = NiRelay(
            NiRelayConfig.model_validate(
                {"server": f"127.0.0.1:{bench.part.port}", "watchdog": WATCHDOG}
            )
        )
        driver.open()
        armed(driver)
    with pytest.raises(LinkError, match=r"(switch|read) a line .*UNAVAILABLE"):
        cycles(driver, 1.0, lambda: False)
    driver.make_safe()
    with pytest.raises(LinkError):
        driver.confirm_safe()
    driver.close()
    driver.close()


def test_removed_card_is_reported_and_relay_is_open(rig: Rig) -> None:
    driver = armed(rig.opened())
    cycles(driver, 1.0, lambda: rig.bench.closed)
    rig.inject("removal")
    assert not rig.bench.closed  # its lines float up: why a relay should close on low
    with pytest.raises(DeviceError, match=r"is gone .*-201003"):
        cycles(driver, 1.0, lambda: False)


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"device": "Dev2"}, LinkError, "there is no NI card Dev2"),
        ({"product": "USB-6001"}, ProtocolError, "is a USB-6009, expected a USB-6001"),
        ({"line": "port2/line0"}, DeviceError, "-200170"),
        ({"line": "port1/line4"}, DeviceError, "-200170"),
    ],
)
def test_wrong_card_or_missing_lines_are_refused(
    rig: Rig, options: dict[str, Any], kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words):
        rig.opened(**options)


def test_line_named_twice_is_refused() -> None:
    with pytest.raises(ValidationError, match="port0/line1 is named twice"):
        NiRelayConfig.model_validate({"watchdog": {**WATCHDOG, "feedback": "port0/line1"}})


def test_relay_active_high_closes_on_high_level(rig: Rig) -> None:
    driver = armed(rig.opened(active="high", watchdog=None))
    assert rig.bench.line[-1][1]  # low: open, for that relay
    cycles(driver, 1.0, lambda: row(driver)[0] == 1.0)
    assert not rig.bench.line[-1][1]


KILLED = """\
    import sys, time
    from rigd_drivers.cards.ni_relay import NiRelay
    from rigd_drivers.cards.ni_relay.config import NiRelayConfig

    driver = NiRelay(NiRelayConfig.model_validate_json(sys.argv[1]))
    driver.open()
    driver.arm()
    while True:
        row = driver.read(time.monotonic_ns())
        driver.write((float(driver.ready()),))
        if row is not None and row[0]:
            print("closed", flush=True)
        time.sleep(0.002)
"""


@contextmanager
def a_client(rig: Rig) -> Iterator[subprocess.Popen[str]]:
    """A process of its own that has closed the relay."""
    options = rig.make().config.model_dump(mode="json")
    options["watchdog"]["time"] = f"{ONE_SHOT_S} s"
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(KILLED), json.dumps(options)],
        stdout=subprocess.PIPE,
        text=True,
    ) as client:
        try:
            assert client.stdout is not None
            assert client.stdout.readline() == "closed\n"
            # Any number of reports is allowed.
            threading.Thread(target=client.stdout.read, daemon=True).start()
            yield client
        finally:
            client.kill()


def test_after_kill_one_shot_or_second_link_opens(rig: Rig) -> None:
    with a_client(rig) as client:
        assert rig.bench.closed
        client.kill()
        client.wait()
        with witnessed() as lost_s:
            killed_ns = time.monotonic_ns()
            deadline = time.monotonic() + WAIT_S
            while rig.bench.closed:
                assert time.monotonic() < deadline
                time.sleep(0.005)
            assert (time.monotonic_ns() - killed_ns) * 1e-9 < ONE_SHOT_S + 0.2 + lost_s()
        assert rig.bench.line[-1][1]  # the card keeps its line
        rescuer = rig.make()
        rescuer.rescue()
        assert not rig.bench.line[-1][1]
    armed(rig.opened())  # and what the server kept does not interfere


def test_next_client_clears_what_killed_one_left(rig: Rig) -> None:
    with a_client(rig) as client:
        client.kill()
        client.wait()
        driver = rig.opened()
        assert not rig.bench.line[-1][1]
        assert rig.on_loop(rig.bench.part.state)["tasks"] == 2
        armed(driver)


def test_relay_of_running_client_is_refused(rig: Rig) -> None:
    with a_client(rig):
        with pytest.raises(LinkError, match=r"one-shot .* stays up: another rigd"):
            rig.opened()
        assert rig.bench.closed


def test_defect_one_shot_after_kill_is_named_so(rig: Rig) -> None:
    with a_client(rig) as client:
        client.kill()
        client.wait()
        rig.bench.one_shot.dead = True
        with pytest.raises(LinkError, match="no longer falls by itself"):
            rig.opened()


def test_lines_of_another_program_are_refused(rig: Rig) -> None:
    rig.opened()
    other = rig.make(line="port0/line1", watchdog=None)
    with pytest.raises(LinkError, match=r"cannot take lines of .*-200587"):
        other.open()


@contextmanager
def simulated() -> Iterator[Peer]:
    """Start a card for the conformance suite."""
    bench = Bench()
    with background_loop() as run:

        async def stall() -> None:
            bench.part.inject("stall", seconds=3600)

        async def slow() -> None:
            bench.part.inject("stall", seconds=1.0)

        run(bench.part.start())
        try:
            yield Peer(
                options={"server": f"127.0.0.1:{bench.part.port}"},
                faults={
                    "dead": lambda: run(bench.part.stop()),
                    "silent": lambda: run(stall()),
                    "late": lambda: run(slow()),
                    "unguarded": lambda: setattr(bench.one_shot, "dead", True),
                },
                observed=bench.observed,
            )
        finally:
            run(bench.part.stop())


def test_it_keeps_what_a_driver_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigd_drivers.cards.ni_card.CONNECT_S", 1.0)
    wired = {"active": "low", "watchdog": WATCHDOG}  # as the relay of the bench closes
    report = check_driver(NiRelay, wired, peer=simulated)
    assert report.skipped.keys() == {
        "garbled", "garbled at open", "frozen", "safe while stuck", "ready is true",
        "refused", "another at open",
    }  # fmt: skip
