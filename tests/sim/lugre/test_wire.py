"""The bench as a whole: physics behind the wire, its control socket, its folder."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.can.bus import Client, run
from support.can.nodes import FEEDBACK, SPEED_COMMAND, TORQUE_COMMAND, pdo, written
from support.commands.command import rigd, start
from support.wire import ROOT, wire_rig, write_rig

from rigd.model.errors import ConfigError
from rigd.sdk import LinkError
from rigd_sim.lugre.wire import WireLugre, WireLugreConfig
from rigd_sim.lugre.wire_parts import BUILDERS, DeviceOptions

#: Without what needs a port of the machine.
QUIET = {"accelerometer": None, "plant": {"noise": False}}
PATIENCE_S = 30.0


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder whose name is short enough for sockets."""
    with tempfile.TemporaryDirectory(prefix="rigd-", dir="/tmp") as path:
        yield Path(path)


@contextmanager
def served(
    folder: Path, *, file: Path | None = None, **options: object
) -> Iterator[tuple[WireLugre, list[str]]]:
    """The bench, served by a thread as long as this lasts."""
    bench = WireLugre(WireLugreConfig.model_validate({"folder": folder, **QUIET, **options}))
    lines: list[str] = []
    ready, end = threading.Event(), threading.Event()

    def started(given: Sequence[str]) -> None:
        lines.extend(given)
        ready.set()

    with ThreadPoolExecutor(1) as pool:
        serving = pool.submit(bench.serve, started, end.is_set, file)
        serving.add_done_callback(lambda _: ready.set())
        try:
            ready.wait(PATIENCE_S)
            if serving.done():
                serving.result()
            yield bench, lines
        finally:
            end.set()
        serving.result(PATIENCE_S)


def wait_for(look: Callable[[], Mapping[str, Any]], ready: Callable[[Any], bool]) -> Any:
    """Return what ``look`` gives once it is ``ready``."""
    deadline = time.monotonic() + PATIENCE_S
    while not ready(state := look()):
        assert time.monotonic() < deadline, state
        time.sleep(0.005)
    return state


def part(bench: WireLugre, name: str) -> Callable[[], Mapping[str, Any]]:
    return lambda: bench.ask({"do": "state"})["parts"][name]


def test_every_device_is_announced_and_all_are_stopped(folder: Path) -> None:
    with served(folder) as (bench, lines):
        assert [line.partition(":")[0] for line in lines] == [
            "servo_bus", "encoder_bus", "wheel_servo", "longitudinal_belt", "lateral_belt",
            "wheel_encoder", "carriage", "scale",
        ]  # fmt: skip
        assert lines[2] == "wheel_servo: rigd simulated servo, node 1 on servo_bus"
        state = bench.ask({"do": "state"})
        assert abs(state["t_ns"] - time.monotonic_ns()) < PATIENCE_S * 1e9
        assert state["plant"]["floor"] == "stone"
        assert all(
            item["nmt"] == "pre_operational" for item in state["parts"].values() if "nmt" in item
        )
    assert [path.name for path in folder.iterdir()] == ["lock"]
    with pytest.raises(LinkError, match=r"no simulation answers .*\n.*rigd sim"):
        bench.ask({"do": "state"})


def test_every_device_has_options_and_a_builder() -> None:
    of_any_name = {"can_sensors"}
    assert set(BUILDERS) | of_any_name == set(DeviceOptions.model_fields)


async def _drive(folder: Path, per_mille: int, cycles: int) -> list[bytes]:
    """Enable the wheel servo and cycle it with a torque; return its TPDOs."""
    client = Client(folder / "servo_bus")
    try:
        await written(
            client, 1, *pdo(1, 1, *FEEDBACK), *pdo(1, 1, *TORQUE_COMMAND, receive=True),
            "2f 60 60 00 0a 00 00 00",
        )  # fmt: skip
        client.send(0x000, "01 01")
        answers = []
        for number in range(cycles):
            control = (6, 7, 15)[min(number, 2)]
            target = per_mille.to_bytes(2, "little", signed=True).hex()
            client.send(0x201, f"{control:02x}00{target}")
            client.send(0x080)
            answers.append(bytes.fromhex(await client.until(0x181)))
        return answers
    finally:
        client.close()


def test_torque_at_wire_turns_wheel_until_reset(folder: Path) -> None:
    with served(folder) as (bench, _):
        answers = run(_drive(folder, 500, 300))
        counts = [int.from_bytes(answer[4:], "little", signed=True) for answer in answers]
        torques = [int.from_bytes(answer[2:4], "little", signed=True) for answer in answers]
        # The belt holds the carriage, so that the wheel spins: 0.75 A of 1.5 A nominal.
        assert torques[-1] == pytest.approx(500, abs=2)
        assert counts[0] == 0
        assert counts[-1] > 10
        state = bench.ask({"do": "state"})
        assert state["parts"]["wheel_servo"]["current"] == pytest.approx(0.75)
        assert state["plant"]["motor_current"] == pytest.approx(0.75, abs=1e-3)
        assert state["parts"]["wheel_encoder"]["angle"] > 0
        before = time.monotonic_ns()
        bench.ask({"do": "fault", "part": "wheel_servo", "fault": "reset"})
        state = bench.ask({"do": "state"})["parts"]["wheel_servo"]
        assert before <= state["safe_since_ns"] <= time.monotonic_ns()
        assert state["current"] == 0.0


async def _move_belt(
    folder: Path, speed_mrpm: int, *, until: int = 0, release: bool = False
) -> None:
    """Run the longitudinal belt ``until`` so many counts, or 100 cycles long if released."""
    client = Client(folder / "servo_bus")
    try:
        await written(
            client, 2, *pdo(1, 2, *FEEDBACK), *pdo(1, 2, *SPEED_COMMAND, receive=True),
            "2f 60 60 00 09 00 00 00", f"23 fe 60 01 00 00 {int(release):02x} 00",
        )  # fmt: skip
        client.send(0x000, "01 02")
        target = speed_mrpm.to_bytes(4, "little", signed=True).hex()
        position = number = 0
        while position < until or number < 100:
            control = (6, 7, 15)[min(number, 2)]
            client.send(0x202, f"{control:02x}00{target}")
            client.send(0x080)
            answer = bytes.fromhex(await client.until(0x182))
            position = int.from_bytes(answer[4:], "little", signed=True)
            number += 1
    finally:
        client.close()


def test_belt_at_wire_moves_carriage_until_fault(folder: Path) -> None:
    with served(folder) as (bench, _):
        # 120 turns per minute at 100 mm a turn are 0.2 m/s; 2048 counts are 50 mm.
        run(_move_belt(folder, 120_000, until=2048))
        state = bench.ask({"do": "state"})
        assert state["parts"]["longitudinal_belt"]["speed"] == pytest.approx(0.2)
        assert state["plant"]["carriage_speed"] == pytest.approx(0.2, rel=0.1)
        assert state["parts"]["carriage"]["position"] >= 0.05
        bench.ask({"do": "fault", "part": "longitudinal_belt", "fault": "fault"})
        braked = wait_for(
            lambda: bench.ask({"do": "state"})["plant"],
            lambda plant: abs(plant["carriage_speed"]) < 1e-3,
        )
        assert braked["carriage_position"] < 1.0


def test_released_clutch_leaves_carriage_where_it_is(folder: Path) -> None:
    with served(folder) as (bench, _):
        run(_move_belt(folder, 120_000, until=0, release=True))
        state = bench.ask({"do": "state"})
        assert state["parts"]["longitudinal_belt"]["released"] is True
        assert abs(state["plant"]["carriage_position"]) < 1e-6


def test_settings_change_the_plant(folder: Path) -> None:
    with served(folder) as (bench, _):
        bench.ask({"do": "change", "quantity": "floor", "value": "pvc"})
        bench.ask({"do": "change", "quantity": "mass", "value": 5.5})
        assert bench.ask({"do": "state"})["plant"]["floor"] == "pvc"
        wait_for(part(bench, "scale"), lambda scale: scale["shown"] == "5.500 kg")


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"do": "dance"}, "cannot do 'dance'"),
        ({}, "cannot do None"),
        ({"do": "state", "of": "all"}, r"unknown \['of'\]"),
        ({"do": "change", "quantity": "floor"}, r"missing \['value'\]"),
        (
            {"do": "change", "quantity": "floor", "value": "ice"},
            "floor cannot be 'ice': it takes stone",
        ),
        ({"do": "fault", "part": "wheel", "fault": "x"}, "no part 'wheel'; there are servo_bus"),
        ({"do": "fault", "part": "carriage"}, "fault: Field required"),
        ({"do": "fault", "part": "scale", "fault": "x", "for_s": -1}, "for: .*greater than 0"),
        ({"do": "clear", "part": "wheel"}, "no part 'wheel'"),
        ({"do": "clear", "part": ["carriage"]}, "'part' is .*, expected a name"),
    ],
)
def test_refused_request_lists_possible_values(
    shared: WireLugre, request_: dict[str, object], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        shared.ask(request_)


@pytest.fixture(scope="module")
def shared() -> Iterator[WireLugre]:
    """A bench for questions that change nothing."""
    with (
        tempfile.TemporaryDirectory(prefix="rigd-", dir="/tmp") as path,
        served(Path(path)) as (bench, _),
    ):
        yield bench


def test_lines_that_are_no_requests_are_answered_too(shared: WireLugre) -> None:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(shared.config.folder / "control"))
        with connection.makefile("rb") as answers:
            for line, words in ((b"hello\n", "Expecting value"), (b"[1]\n", "is a JSON object")):
                connection.sendall(line)
                assert words in json.loads(answers.readline())["error"]


def test_every_fault_is_listed_with_what_it_does(shared: WireLugre) -> None:
    parts = shared.ask({"do": "faults"})["parts"]
    assert "setpoint_ignored" in parts["wheel_servo"]
    assert "sign_flip" in parts["carriage"]
    assert "babble" in parts["encoder_bus"]
    assert all(what for faults in parts.values() for what in faults.values())


def test_faults_at_a_time_and_by_condition(folder: Path) -> None:
    with served(folder) as (bench, _):
        fault = {"do": "fault", "part": "carriage", "fault": "tpdo_stale"}
        bench.ask({**fault, "after_s": 0.05, "for_s": 0.2})
        carriage = part(bench, "carriage")
        assert carriage()["faults"] == ""
        wait_for(carriage, lambda item: item["faults"] == "tpdo_stale")
        wait_for(carriage, lambda item: item["faults"] == "")
        bench.ask({**fault, "when": "plant.mass > 5 kg"})
        assert carriage()["faults"] == ""
        bench.ask({"do": "change", "quantity": "mass", "value": 6})
        wait_for(carriage, lambda item: item["faults"] == "tpdo_stale")
        bench.ask({"do": "clear"})
        assert carriage()["faults"] == ""


def test_options_that_are_refused_later_show_in_state(folder: Path) -> None:
    with served(folder) as (bench, _):
        bench.ask({"do": "fault", "part": "carriage", "fault": "jump", "after_s": 0.01})
        state = wait_for(lambda: bench.ask({"do": "state"}), lambda item: item["problems"])
        assert "carriage: jump: option 'counts' is missing" in state["problems"][0]


def test_fault_file_plays_and_invalid_one_ends_simulation(folder: Path) -> None:
    path = folder / "faults.yaml"
    path.write_text("faults:\n  - {part: servo_bus, fault: drop, at: 10 ms}\n")
    with served(folder, file=path) as (bench, _):
        wait_for(part(bench, "servo_bus"), lambda bus: bus["faults"] == "drop")
    path.write_text("faults:\n  - {part: servo_bus, fault: rain}\n")
    with (
        pytest.raises(ConfigError, match="servo_bus has no fault 'rain'"),
        served(folder, file=path),
    ):
        pass


def test_the_fault_file_of_the_documentation_is_right(folder: Path) -> None:
    text = (ROOT / "docs" / "simulation.md").read_text("utf-8")
    (shown,) = re.findall(r"^```yaml fragment\n(faults:.*?)```$", text, re.M | re.S)
    path = folder / "faults.yaml"
    path.write_text(shown)
    with served(folder, file=path) as (bench, _):
        known = bench.ask({"do": "faults"})["parts"]
    # Every fault of buses and nodes is named in the text.
    for part_ in ("servo_bus", "wheel_servo", "carriage"):
        assert [item for item in known[part_] if f"`{item}`" not in text] == []


def test_faults_of_rig_file_show_from_start(folder: Path) -> None:
    faults = [{"part": "carriage", "fault": "sign_flip"}]
    with served(folder, faults=faults) as (bench, _):
        assert part(bench, "carriage")()["faults"] == "sign_flip"


def test_bus_takes_time_that_its_bits_take(folder: Path) -> None:
    buses = {"servo_bus": {"bitrate": "20 kbit/s"}, "encoder_bus": {}}
    with served(folder, buses=buses) as (bench, _):
        start = time.monotonic()
        run(_drive(folder, 0, 10))
        # SYNC 55 bits, RPDO of 4 bytes 95, TPDO of 8 bytes 135: ten times.
        assert time.monotonic() - start > 10 * 285 / 20e3
        assert part(bench, "servo_bus")()["load"] > 0


def test_one_folder_serves_one_simulation(folder: Path) -> None:
    with (
        served(folder),
        pytest.raises(LinkError, match=f"in use by another `rigd sim`, process {os.getpid()}"),
        served(folder),
    ):
        pass
    with served(folder):
        pass


def test_a_folder_too_deep_for_sockets_is_refused(tmp_path: Path) -> None:
    deep = tmp_path / ("deep" * 25)
    with pytest.raises(LinkError, match="too long for a socket"), served(deep):
        pass


def test_files_of_others_in_folder_are_left_alone(folder: Path) -> None:
    (folder / "notes").symlink_to("elsewhere")
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(folder / "other"))
        with served(folder):
            pass
    assert sorted(path.name for path in folder.iterdir()) == ["lock", "notes", "other"]


def test_node_on_a_missing_bus_is_refused(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"carriage .*'third'.* servo_bus"):
        WireLugreConfig.model_validate({"folder": folder, "carriage": {"bus": "third", "node": 12}})


def test_the_command_serves_and_ends_with_a_signal(tmp_path: Path) -> None:
    rig = write_rig(tmp_path, "sim-ends")
    running = start(["sim", rig.rig], tmp_path)
    assert running.process.stdout is not None
    said = [running.process.stdout.readline()]
    while said[-1] and "Ctrl-C" not in said[-1]:
        said.append(running.process.stdout.readline())
    assert said[-1] == "rig sim-ends is served; Ctrl-C ends it\n"
    assert any(line.startswith("traction: Modbus TCP at") for line in said)
    running.signal(signal.SIGTERM)
    ended = running.end()
    assert (ended.code, ended.err) == (0, f"rig sim-ends ({rig.rig})\n")
    assert [path.name for path in rig.folder.iterdir()] == ["lock"]


def test_drive_is_of_the_make_named(tmp_path: Path) -> None:
    rig = write_rig(tmp_path, "sim-make")
    running = start(["sim", rig.rig, "--profile", "wheel_servo=maxon-epos4"], tmp_path)
    assert running.process.stdout is not None
    said = [running.process.stdout.readline()]
    while said[-1] and "Ctrl-C" not in said[-1]:
        said.append(running.process.stdout.readline())
    assert "wheel_servo: EPOS4, node 1 on servo_bus\n" in said
    assert any(line.startswith("lateral_belt: rigd simulated servo") for line in said)
    running.signal(signal.SIGTERM)
    assert running.end().code == 0
    refused = rigd("sim", rig.rig, "--profile", "carriage=maxon-epos4", cwd=tmp_path)
    assert refused.code == 2
    assert "--profile: no drive is called 'carriage'; there are wheel_servo" in refused.err


def test_killed_simulation_does_not_block_the_next(tmp_path: Path) -> None:
    with wire_rig(tmp_path, "sim-killed") as rig:
        assert rig.process is not None
        rig.process.kill()
        rig.process.wait(PATIENCE_S)
        assert (rig.folder / "servo_bus").is_socket()
        rig.start()
        assert rig.parts()["servo_bus"]["frames"] >= 3


def test_command_refuses_rig_that_it_cannot_serve(tmp_path: Path) -> None:
    ended = rigd("sim", "lugre-1", cwd=tmp_path)
    assert ended.code == 2
    assert "rig lugre-1 has no simulation at the wire" in ended.err
