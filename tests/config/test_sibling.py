"""The simulated sibling of a real rig file: names that agree, what differs, what is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.config.sibling.differences import Difference
from rigd.config.sibling.sibling import Sibling, read_sibling
from rigd.model import ConfigError
from rigd.sdk.shipped_files import shipped_folder

CONFIGS = shipped_folder("configs")
REAL = (CONFIGS / "wire_lugre.yaml").read_text()
SIMULATED = (CONFIGS / "sim_lugre.yaml").read_text()
#: The sibling of the shipped file, renamed, so that only the file beside it is meant.
NAMED = REAL.replace("sibling: sim_lugre.yaml", "sibling: sim.yaml")


def sibling_of(folder: Path, real: str = NAMED, simulated: str = SIMULATED) -> Sibling:
    (folder / "real.yaml").write_text(real)
    (folder / "sim.yaml").write_text(simulated)
    found = read_sibling(load_rig(folder / "real.yaml"))
    assert found is not None
    return found


def refusal_of(folder: Path, real: str = NAMED, simulated: str = SIMULATED) -> str:
    with pytest.raises(ConfigError) as refused:
        sibling_of(folder, real, simulated)
    return str(refused.value)


def place(folder: Path, name: str, token: str) -> str:
    """Where ``token`` begins in a file, as file:line:column."""
    text = (folder / name).read_text()
    head = text[: text.index(token)]
    return f"{folder / name}:{head.count(chr(10)) + 1}:{len(head) - head.rfind(chr(10))}"


def swap(text: str, old: str, new: str) -> str:
    assert old in text, old
    return text.replace(old, new)


@pytest.mark.parametrize(
    "name", ["wire_lugre", "card_lugre", "ni_lugre", "wire_approach_angle", "wire_articulated"]
)
def test_shipped_real_rig_has_a_sibling(name: str) -> None:
    rig = load_rig(CONFIGS / f"{name}.yaml")
    sibling = read_sibling(rig)
    assert sibling is not None
    stand_in = sibling.stand_in(rig)
    assert stand_in.plant is not None
    assert stand_in.simulation is None
    assert stand_in.period_ns == rig.period_ns == sibling.rig.period_ns
    assert stand_in.interlocks == rig.interlocks
    assert stand_in.settable == rig.settable


def test_limits_are_real_and_devices_of_sibling(tmp_path: Path) -> None:
    tighter = swap(
        NAMED, "current: {low: -1.6 A, high: 1.6 A", "current: {low: -1.1 A, high: 1.2 A"
    )
    rig = load_rig("lugre-1")
    sibling = sibling_of(tmp_path, tighter)
    servo = sibling.stand_in(load_rig(tmp_path / "real.yaml")).devices["wheel_servo"]
    assert servo.driver == rig.devices["wheel_servo"].driver
    assert (servo.limits["current"].low, servo.limits["current"].high) == (-1.1, 1.2)
    assert (
        Difference("limits of wheel_servo.current", "-1.1 A .. 1.2 A", "-1.6 A .. 1.6 A")
        in sibling.differences
    )


def test_sibling_is_played_at_real_cycle(tmp_path: Path) -> None:
    slower = swap(SIMULATED, "cycle: 1 kHz", "cycle: 500 Hz")
    sibling = sibling_of(tmp_path, simulated=slower)
    assert sibling.rig.period_ns == 1_000_000
    assert sibling.differences[0] == Difference("cycle", "1000 Hz", "500 Hz")


def test_all_kinds_of_differences_are_listed(tmp_path: Path) -> None:
    text = swap(SIMULATED, "speed: {low: -0.5 m/s, high: 0.5 m/s, rate: 5 m/s^2}",
                "speed: {low: -0.5 m/s, high: 0.5 m/s, rate: 4 m/s^2, rest: 0.1 m/s}")  # fmt: skip
    text = swap(text, "high: 1.65 m\n    action: abort", "high: 1.6 m\n    action: stop")
    text = swap(text, "name: over_current", "name: overcurrent")
    text = swap(text, "wheel_radius: {value: 50 mm", "wheel_radius: {value: 51 mm")
    found = {item.what: (item.here, item.there)
             for item in sibling_of(tmp_path, simulated=text).differences}  # fmt: skip
    assert found["rate of longitudinal_belt.speed"] == ("5 m/s^2", "4 m/s^2")
    assert found["rest of longitudinal_belt.speed"] == ("0 m/s", "0.1 m/s")
    assert found["interlock overrun_far, bounds"] == (".. 1.65 m", ".. 1.6 m")
    assert found["interlock overrun_far, action"] == ("abort", "stop")
    assert found["interlock over_current"] == ("abort", "none")
    assert found["interlock overcurrent"] == ("none", "abort")
    assert found["constant wheel_radius"] == ("50 mm", "51 mm")
    assert found["device traction"] == ("2 channels", "none")
    assert found["device truth"] == ("none", "11 channels")
    assert found["channel wheel_servo.counts"] == ("measured", "none")
    assert found["unit of wheel_servo.current_raw"] == ("1", "V")
    assert found["range of wheel_servo.current"] == ("no bounds", "-25 A .. 25 A")


def test_controller_of_another_channel_is_a_difference(tmp_path: Path) -> None:
    held = """\
controllers:
  hold: {{measured: {0}, output: wheel_servo.current, kp: 1 A/{1}, output_limits: [-1 A, 1 A],
         limits: {{low: 0 {1}, high: 1 {1}}}}}
interlocks:
"""
    real = swap(NAMED, "interlocks:\n", held.format("carriage.position", "m"))
    simulated = swap(SIMULATED, "interlocks:\n", held.format("wheel_encoder.angle", "rad"))
    assert (
        Difference("setpoint hold.position", "commanded", "none")
        in sibling_of(tmp_path, real, simulated).differences
    )


def test_actuator_of_another_name_is_refused(tmp_path: Path) -> None:
    text = SIMULATED.replace("wheel_servo", "wheel_drive")
    refusal = refusal_of(tmp_path, simulated=text)
    here = place(tmp_path, "real.yaml", "current: {low")

    there = place(tmp_path, "sim.yaml", "wheel_drive:")
    assert refusal.splitlines()[0] == (
        f"{here}: wheel_servo.current is a setpoint here, and the sibling has none of this name "
        f"({there})"
    )
    assert "did you mean 'wheel_drive.current'?" in refusal


def test_setpoint_that_only_sibling_has_is_refused(tmp_path: Path) -> None:
    head, _, tail = NAMED.partition("  # Drives the bridge sideways.")
    rest = tail[tail.index("  # Load cell") :]
    text = head + rest
    for name in ("overrun_side", "lateral_belt_follows"):
        start = text.index(f"  - name: {name}")
        text = text[:start] + text[text.index("\n\n", start) + 2 :]
    refusal = refusal_of(tmp_path, text)
    there = place(tmp_path, "sim.yaml", "speed: {low: -0.7")
    assert f"lateral_belt.speed is a setpoint of the sibling ({there})" in refusal
    assert refusal.startswith(str(tmp_path / "real.yaml"))


def test_watched_channel_that_sibling_lacks_is_refused(tmp_path: Path) -> None:
    text = SIMULATED.replace("carriage.", "cart.").replace("  carriage:", "  cart:")
    refusal = refusal_of(tmp_path, simulated=text)
    here = place(tmp_path, "real.yaml", "carriage.position")
    there = place(tmp_path, "sim.yaml", "wheel_servo:\n    driver")
    assert refusal.splitlines()[0] == (
        f"{here}: interlock 'overrun_far' watches carriage.position, and the sibling does not "
        f"measure it ({there})"
    )
    assert "did you mean 'cart'?" in refusal


def test_used_channel_in_another_unit_is_refused(tmp_path: Path) -> None:
    lock = "  - {name: raw, source: wheel_servo.current_raw, action: warn, message: Test}\n"
    text = swap(NAMED, "interlocks:\n", f"interlocks:\n{lock}")
    refusal = refusal_of(tmp_path, text)
    there = place(tmp_path, "sim.yaml", "wheel_servo:\n    driver")
    assert f"measures it in V instead of 1 ({there})" in refusal


def test_slower_rows_than_interlock_allows_are_refused(tmp_path: Path) -> None:
    real = (CONFIGS / "wire_approach_angle.yaml").read_text()
    real = swap(real, "sibling: sim_approach_angle.yaml", "sibling: sim.yaml")
    simulated = (CONFIGS / "sim_approach_angle.yaml").read_text()
    simulated = swap(simulated, "block: 96", "block: 4000")
    simulated = re.sub("    stale_after: .*\n", "", simulated)
    simulated = swap(simulated, "    action: ", "    stale_after: 2 s\n    action: ")
    refusal = refusal_of(tmp_path, real, simulated)
    assert "as lost after 250 ms, and in the sibling its rows become" in refusal


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda real, sim: (real.replace("sim.yaml", "real.yaml"), sim), "is this file itself"),
        (lambda real, sim: (real.replace("sim.yaml", "./real.yaml"), sim), "file itself"),
        (lambda real, sim: (real.replace("sim.yaml", "absent.yaml"), sim), "does not exist"),
        (lambda real, _: (real, REAL), "names a sibling itself"),
        (lambda real, _: (real, REAL.replace("sibling: sim_lugre.yaml", "")), "has no `plant`"),
        (lambda real, sim: (real, sim.replace("rig: lugre-1", "rig: Lugre 1")), "Lugre 1"),
    ],
    ids=["itself", "itself by another path", "missing", "chain", "no plant", "wrong file"],
)  # fmt: skip
def test_wrong_sibling_is_refused_at_its_place(
    tmp_path: Path, change: Callable[[str, str], tuple[str, str]], words: str
) -> None:
    real, simulated = change(NAMED, SIMULATED)
    refusal = refusal_of(tmp_path, real, simulated)
    assert words in refusal
