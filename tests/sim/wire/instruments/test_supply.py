"""The simulated supply by itself: what its output does, obeying commands and failing."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd_sim.wire.instruments.supply import SimSupply


class Heard(SimSupply):
    """A supply whose answers are kept."""

    def __init__(self, path: Path) -> None:
        super().__init__("supply", path)
        self.answers: list[bytes] = []

    def reply(self, line: bytes) -> None:
        self.answers.append(line)


@pytest.fixture
def supply(tmp_path: Path) -> Heard:
    found = Heard(tmp_path / "supply")
    found.on_command(b"OUTP ON")
    found.on_command(b"VOLT 5")
    return found


def test_questions_of_a_line_have_one_answer(supply: Heard) -> None:
    supply.on_command(b"VOLT 6.5;:MEAS:VOLT?;:MEAS:CURR?;:OUTP?")
    supply.on_command(b"VOLT 31")  # beyond its range
    supply.on_command(b"HELLO?")
    supply.on_command(b"MEAS:VOLT?")
    assert supply.answers == [b"6.5000;0.6500;1", b"6.5000"]
    assert supply.state()["sent"] == 2


@pytest.mark.parametrize(
    ("fault", "volts"), [("tripped", 0.0), ("locked", 0.0), ("setpoint_ignored", 5.0)]
)
def test_fault_shows_at_the_output(supply: Heard, fault: str, volts: float) -> None:
    supply.inject(fault)
    supply.on_command(b"VOLT 7")
    assert supply.volts == volts
    assert bool(supply.state()["safe_since_ns"]) is not bool(volts)


def test_stuck_supply_obeys_once_it_is_cleared(supply: Heard) -> None:
    supply.inject("stuck")
    supply.on_command(b"VOLT 0")
    supply.on_command(b"OUTP OFF")
    assert supply.volts == 5.0
    supply.clear()
    assert (supply.volts, supply.state()["set_voltage"]) == (0.0, 0.0)
    assert supply.state()["safe_since_ns"]
