"""The CAN drivers of the shipped rig against the devices that `rigd sim` serves."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.can.foreign import foreign_traffic
from support.faults.rigs import sensors_rig
from support.wire import WireRig

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.sdk import DeviceError, Driver, LinkError, ProtocolError
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen.objects import ABORT_CONNECTION_OPTION
from rigd_drivers.can.cia402_servo.current import CurrentServo

SERVOS = ("wheel_servo", "longitudinal_belt", "lateral_belt")
ENCODERS = ("wheel_encoder", "carriage")
#: What any of these tests waits for happens within this time, on a crowded machine too, in s.
PATIENCE_S = 20.0
ENGAGED = {"longitudinal_belt": (0.0, 1.0), "lateral_belt": (0.0, 1.0), "wheel_servo": (0.0,)}


@dataclass
class Rig:
    """The buses and CAN devices of the rig, exchanged with as a cycle does."""

    links: dict[str, CanBus]
    devices: dict[str, Driver]

    def open(self) -> None:
        for link in self.links.values():
            link.open()
        for device in self.devices.values():
            device.open()

    def close(self) -> None:
        for device in self.devices.values():
            device.close()
        for link in self.links.values():
            link.close()

    def cycle(self, setpoints: dict[str, tuple[float, ...]]) -> dict[str, Sequence[float] | None]:
        for link in self.links.values():
            link.begin(0)
        rows = {name: device.read(0) for name, device in self.devices.items()}
        for name, values in (ENGAGED | setpoints).items():
            if name in self.devices:
                self.devices[name].write(values)
        for link in self.links.values():
            link.end(0)
        return rows

    def run(
        self,
        until: Callable[[dict[str, Sequence[float]]], bool],
        **setpoints: tuple[float, ...],
    ) -> dict[str, Sequence[float]]:
        """Run cycles until ``until(newest rows)``; return these."""
        newest: dict[str, Sequence[float]] = {}
        deadline = time.monotonic() + PATIENCE_S
        while not until(newest):
            assert time.monotonic() < deadline, newest
            rows = self.cycle(setpoints)
            newest |= {name: row for name, row in rows.items() if row is not None}
            time.sleep(1e-3)
        return newest

    def complete(self, newest: dict[str, Sequence[float]]) -> bool:
        return newest.keys() == self.devices.keys()

    def arm(self) -> None:
        self.run(self.complete)
        for device in self.devices.values():
            device.arm()
        self.run(lambda _: all(device.ready() for device in self.devices.values()))


def made(config: RigConfig, names: Sequence[str]) -> Rig:
    """The named devices of the rig with links of their own, nothing opened yet."""
    links: dict[str, CanBus] = {}
    devices: dict[str, Driver] = {}
    for name in names:
        device = config.devices[name]
        assert device.link is not None
        setup = config.links[device.link]
        link = links.get(device.link)
        if link is None:
            made_link = setup.link_class(setup.config)
            assert isinstance(made_link, CanBus)
            link = links[device.link] = made_link
        driver = device.driver_class(device.config, link)
        assert isinstance(driver, Driver)
        devices[name] = driver
    return Rig(links, devices)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    # A crowded machine may well stall for 100 ms: here the drives wait longer for the heartbeat.
    patient = {"watchdog: 100 ms": "watchdog: 1 s"}
    with sensors_rig(tmp_path_factory.mktemp("can"), patient) as rig:
        yield rig


@pytest.fixture
def bench(served: WireRig) -> Iterator[WireRig]:
    """The simulation, without faults."""
    yield served
    served.ask(do="clear")


@pytest.fixture
def config(bench: WireRig) -> RigConfig:
    return load_rig(bench.rig)


@pytest.fixture
def rig(config: RigConfig) -> Iterator[Rig]:
    whole = made(config, [*SERVOS, *ENCODERS])
    yield whole
    for device in whole.devices.values():
        device.make_safe()
    whole.close()


def test_current_moves_carriage_and_safe_takes_it_away(bench: WireRig, rig: Rig) -> None:
    rig.open()
    for name in SERVOS:
        took_s = rig.devices[name].prove_watchdog()
        assert 0.5 < took_s <= (rig.devices[name].watchdog_s or 0.0)
    rig.arm()
    start = rig.run(rig.complete)
    free = {"longitudinal_belt": (0.0, 0.0), "wheel_servo": (0.9,)}
    there = rig.run(lambda row: "carriage" in row and row["carriage"][0] > 0.05, **free)
    assert there["wheel_servo"][0] == pytest.approx(0.9, abs=0.1)
    assert there["wheel_encoder"][0] > start["wheel_encoder"][0] + 0.5  # 50 mm on 50 mm radius
    # The drive's own counts give the motor's angle, the encoder's the wheel's, behind the gear.
    turned = there["wheel_servo"][2] / 20.25
    assert turned == pytest.approx(there["wheel_encoder"][0], abs=0.05)
    back = {"longitudinal_belt": (-0.2, 1.0)}
    rig.run(lambda row: "carriage" in row and row["carriage"][0] < 0.01, **back)
    assert bench.parts()["longitudinal_belt"]["speed"] == pytest.approx(-0.2, rel=1e-3)
    for device in rig.devices.values():
        device.make_safe()
    parts = bench.parts()
    for name in SERVOS:
        assert not parts[name]["enabled"]
        assert parts[name]["safe_since_ns"] > 0


def test_rig_drives_and_stops_beside_foreign_frames(bench: WireRig, config: RigConfig) -> None:
    buses = [bench.folder / name for name in ("servo_bus", "encoder_bus")]
    whole = made(config, [*SERVOS, *ENCODERS, "cell", "wheel_load"])
    with foreign_traffic(buses, 1000.0):
        whole.open()
        for name in SERVOS:
            whole.devices[name].prove_watchdog()
        whole.arm()
        whole.run(
            lambda row: "lateral_belt" in row and row["lateral_belt"][0] > 0.05,
            lateral_belt=(0.3, 1.0),
        )
        whole.run(
            lambda row: "lateral_belt" in row and row["lateral_belt"][0] < 0.005,
            lateral_belt=(-0.1, 1.0),
        )
        for device in whole.devices.values():
            device.make_safe()
        for link in whole.links.values():
            link.idle()
        for device in whole.devices.values():
            device.confirm_safe()
        assert not any(bench.parts()[name]["enabled"] for name in SERVOS)
        assert all(link.foreign > 100 for link in whole.links.values())
        whole.close()


def test_bridge_moves_to_position_at_commanded_speed(rig: Rig) -> None:
    rig.open()
    rig.arm()
    row = rig.run(
        lambda row: "lateral_belt" in row and row["lateral_belt"][0] > 0.05,
        lateral_belt=(0.3, 1.0),
    )
    assert row["lateral_belt"][1] == pytest.approx(0.3, abs=0.05)
    rig.run(
        lambda row: "lateral_belt" in row and row["lateral_belt"][0] < 0.005,
        lateral_belt=(-0.1, 1.0),
    )


def test_silent_cycle_is_switched_off_by_its_drives(bench: WireRig, rig: Rig) -> None:
    rig.open()
    rig.arm()
    rig.run(lambda row: bool(row) and row["wheel_servo"][0] > 0.1, wheel_servo=(0.3,))
    last_ns = time.monotonic_ns()
    deadline = time.monotonic() + PATIENCE_S
    while not all(bench.parts()[name]["safe_since_ns"] for name in SERVOS):
        assert time.monotonic() < deadline
    for name in SERVOS:
        bound_ns = (rig.devices[name].watchdog_s or 0.0) * 1e9
        assert bench.parts()[name]["safe_since_ns"] - last_ns < bound_ns
    with pytest.raises(DeviceError, match="heartbeat of the master lost"):
        rig.run(lambda _: False)


def test_rescue_switches_drives_off_before_their_watchdog(
    bench: WireRig, rig: Rig, config: RigConfig
) -> None:
    rig.open()
    rig.arm()
    rig.run(lambda row: bool(row) and row["wheel_servo"][0] > 0.1, wheel_servo=(0.3,))
    for name in SERVOS:  # the rig itself is left as if its process had been killed
        made(config, [name]).devices[name].rescue()
        assert not bench.parts()[name]["enabled"]
    for link in rig.links.values():
        link.close()


def test_drive_stopped_by_another_master_is_switched_off(bench: WireRig, rig: Rig) -> None:
    rig.open()
    rig.arm()
    wheel = rig.devices["wheel_servo"]
    assert isinstance(wheel, CurrentServo)
    wheel._opened().write(ABORT_CONNECTION_OPTION, 0)  # a drive that does not mind its NMT state
    rig.run(lambda row: bool(row) and row["wheel_servo"][0] > 0.1, wheel_servo=(0.3,))
    rig.links["servo_bus"].send(0x000, b"\x02\x01")
    for device in rig.devices.values():
        device.make_safe()
    assert bench.parts()["wheel_servo"]["enabled"]
    for device in rig.devices.values():
        device.confirm_safe()
    assert not any(bench.parts()[name]["enabled"] for name in SERVOS)


def test_second_rigd_is_refused_and_first_continues(rig: Rig, config: RigConfig) -> None:
    rig.open()
    rig.arm()
    second = made(config, ["wheel_servo"]).links["servo_bus"]
    refused: list[str] = []

    def intrude() -> None:
        try:
            second.open()
        except LinkError as error:
            refused.append(error.message)

    intruder = threading.Thread(target=intrude)
    intruder.start()
    rig.run(lambda _: not intruder.is_alive())
    intruder.join()
    assert refused
    assert "another rigd (or CANopen master) drives" in refused[0]
    assert rig.devices["wheel_servo"].ready()


@pytest.mark.parametrize(
    ("part", "fault", "options", "message"),
    [
        ("wheel_servo", "emergency", {"code": 0x2310}, "overcurrent at the output"),
        ("wheel_servo", "reset", {}, "has restarted|no longer operational"),
        ("wheel_servo", "fault", {}, "left operation enabled: fault"),
        ("wheel_servo", "setpoint_ignored", {}, "ignores its target"),
        ("lateral_belt", "tpdo_short", {}, "has 7 bytes, mapped were 8"),
        ("longitudinal_belt", "tpdo_duplicate", {}, "comes more often than SYNC"),
        ("wheel_servo", "heartbeat_missing", {}, "sent no heartbeat"),
        ("carriage", "emergency", {"code": 0x7305}, "encoder 1 error"),
        ("carriage", "reset", {}, "has restarted"),
        ("carriage", "tpdo_short", {}, "has 3 bytes, mapped were 4"),
        ("servo_bus", "bus_off", {}, "bus-off|only errors|frames are destroyed"),
        ("servo_bus", "babble", {"id": 0x3A5, "rate_hz": 20_000.0, "length": 8}, "0x3A5"),
        ("servo_bus", "stalled", {}, "takes no frames|heartbeat of the master lost"),
    ],
)
def test_failure_in_the_cycle_is_reported(
    bench: WireRig, rig: Rig, part: str, fault: str, options: dict[str, float], message: str
) -> None:
    rig.open()
    rig.arm()
    bench.ask(do="fault", part=part, fault=fault, options=options)
    with pytest.raises((DeviceError, LinkError, ProtocolError), match=message):
        rig.run(lambda _: False)
    bench.ask(do="clear")


@pytest.mark.parametrize(
    ("part", "fault", "options", "message"),
    [
        ("wheel_servo", "mapping_refused", {}, "cannot be mapped to a PDO"),
        ("wheel_servo", "sdo_silent", {}, "node 1 .*does not answer"),
        ("wheel_servo", "sdo_wrong_toggle", {}, "toggle bit of a segment is wrong"),
        ("wheel_servo", "sdo_abort", {"code": 0x08000022, "index": 0x1016}, "1016:01"),
        ("wheel_servo", "twin", {}, "two nodes answer under node id 1|SDO transfer of"),
        ("carriage", "twin", {}, "two nodes answer under node id 12|SDO transfer of"),
        ("wheel_servo", "silent", {}, "node 1 .*does not answer"),
        ("servo_bus", "wrong_bitrate", {}, "reports errors|only errors are heard"),
    ],
)
def test_problem_at_opening_is_reported_and_nothing_moves(
    bench: WireRig, rig: Rig, part: str, fault: str, options: dict[str, float], message: str
) -> None:
    bench.ask(do="fault", part=part, fault=fault, options=options)
    with pytest.raises((LinkError, ProtocolError), match=message):
        rig.open()
    assert not any(bench.parts()[name]["enabled"] for name in SERVOS)
    bench.ask(do="clear")


def test_drive_with_dead_watchdog_is_not_proven(bench: WireRig, rig: Rig) -> None:
    rig.open()
    bench.ask(do="fault", part="wheel_servo", fault="watchdog_dead", options={})
    with pytest.raises(DeviceError, match="did not switch itself off within"):
        rig.devices["wheel_servo"].prove_watchdog()
    assert not bench.parts()["wheel_servo"]["enabled"]


def test_twin_that_comes_later_is_seen_in_cycle(bench: WireRig, rig: Rig) -> None:
    rig.open()
    rig.arm()
    bench.ask(do="fault", part="wheel_servo", fault="twin", options={})
    with pytest.raises((DeviceError, ProtocolError), match=r"has restarted|more often than SYNC"):
        rig.run(lambda _: False)


def test_wrong_node_id_finds_another_kind_of_device(config: RigConfig) -> None:
    wheel = config.devices["wheel_servo"]
    setup = config.links["encoder_bus"]
    link = setup.link_class(setup.config)
    driver = wheel.driver_class(wheel.config.model_copy(update={"node": 11}), link)
    assert isinstance(driver, Driver)
    link.open()
    try:
        with pytest.raises(ProtocolError, match=r"device profile 406 .*expected 402"):
            driver.open()
        driver.close()
    finally:
        link.close()


def test_folder_of_bus_is_named_when_nothing_runs(tmp_path: Path) -> None:
    from rigd_drivers.can.ports import open_port

    with pytest.raises(LinkError, match=str(tmp_path)):
        open_port("hub", str(tmp_path / "servo_bus"), 1_000_000)
