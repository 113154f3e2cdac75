"""Faults as data: when they begin and end, by time, chance or condition, and what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest

from rigd.model.errors import ConfigError
from rigd_sim.wire.faults import Condition, FaultEntry, Schedule, read_fault_file
from rigd_sim.wire.part import Part, State


class Lamp(Part):
    """A part that remembers its commands."""

    faults: ClassVar[Mapping[str, str]] = {"dark": "gives no light (much)", "flicker": "flickers"}

    def __init__(self) -> None:
        self.name = "lamp"
        self.shown: dict[str, dict[str, Any]] = {}
        self.told: list[str] = []
        self.heat = 0.0

    async def start(self) -> str:
        return "lamp"

    async def stop(self) -> None:
        pass

    def state(self) -> State:
        return {"heat": self.heat, "mode": "warm", "lit": "dark" not in self.shown}

    def inject(self, fault: str, **options: Any) -> None:
        if options.keys() - {"much"}:
            raise ValueError(f"fault {fault!r} takes much")
        self.shown[fault] = options
        self.told.append(f"+{fault}")

    def clear(self, fault: str | None = None) -> None:
        for item in list(self.shown) if fault is None else [fault]:
            self.shown.pop(item, None)
            self.told.append(f"-{item}")


def schedule() -> tuple[Schedule, Lamp]:
    lamp = Lamp()
    return Schedule({"lamp": lamp}, {"lamp": lamp.state}, seed=1), lamp


def entry(**keys: object) -> FaultEntry:
    return FaultEntry.model_validate({"part": "lamp", "fault": "dark", **keys})


def test_fault_without_time_shows_at_once_until_cleared() -> None:
    plan, lamp = schedule()
    plan.add(entry(options={"much": 1}), 100.0)
    assert lamp.shown == {"dark": {"much": 1}}
    plan.tick(1e6)
    assert lamp.shown
    plan.clear("lamp", "dark")
    assert not lamp.shown


def test_a_fault_begins_and_ends_at_its_time() -> None:
    plan, lamp = schedule()
    plan.add(entry(at="2 s", **{"for": "500 ms"}), 100.0)
    seen = []
    for now in (100.0, 101.9, 102.0, 102.4, 102.5, 110.0):
        plan.tick(now)
        seen.append(bool(lamp.shown))
    assert seen == [False, False, True, True, False, False]


def test_a_condition_begins_a_fault_once() -> None:
    plan, lamp = schedule()
    plan.add(entry(when="lamp.heat >= 0.5", **{"for": "1 s"}), 0.0)
    for now, heat in ((1.0, 0.4), (2.0, 0.5), (3.5, 0.6), (5.0, 0.7)):
        lamp.heat = heat
        plan.tick(now)
    assert lamp.told == ["+dark", "-dark"]


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("lamp.heat > 400 mm", True),
        ("lamp.heat<0.5", False),
        ("lamp.heat <= 0.5", True),
        ("lamp.mode == warm", True),
        ("lamp.mode != warm", False),
        ("lamp.lit == true", True),
    ],
)
def test_conditions_compare_numbers_in_si_words_and_truth(text: str, holds: bool) -> None:
    lamp = Lamp()
    lamp.heat = 0.5
    assert Condition.read(text).holds({"lamp": lamp.state}) is holds


def test_random_fault_recurs_and_repeats_with_its_seed() -> None:
    told = []
    for _ in range(2):
        plan, lamp = schedule()
        plan.add(entry(probability="2 1/s", **{"for": "10 ms"}), 0.0)
        for step in range(1, 20001):
            plan.tick(step * 0.005)
        told.append(lamp.told)
    assert told[0] == told[1]
    # 100 s at 2 per second, each followed by 10 ms in which it cannot begin.
    assert 150 < told[0].count("+dark") < 250
    assert told[0][:4] == ["+dark", "-dark"] * 2


def test_clearing_removes_planned_faults() -> None:
    plan, lamp = schedule()
    plan.add(entry(at="1 s"), 0.0)
    plan.add(entry(fault="flicker", at="1 s"), 0.0)
    plan.clear("lamp", "dark")
    plan.tick(2.0)
    assert list(lamp.shown) == ["flicker"]
    plan.clear()
    assert not lamp.shown


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"part": "bulb"}, "no part 'bulb'; there are lamp"),
        ({"fault": "broken"}, "lamp has no fault 'broken'; it knows dark: gives no light"),
        ({"when": "bulb.heat > 1"}, "no part 'bulb'"),
        ({"when": "lamp.cold > 1"}, "lamp has no 'cold'; it has heat, mode, lit"),
        ({"options": {"more": 1}}, "takes much"),
    ],
)
def test_wrong_names_are_reported_at_once(keys: dict[str, Any], words: str) -> None:
    plan, lamp = schedule()
    with pytest.raises(ValueError, match=words):
        plan.add(entry(**keys), 0.0)
    assert not lamp.told


def test_options_refused_later_are_reported_without_effect() -> None:
    plan, lamp = schedule()
    plan.add(entry(options={"more": 1}, at="1 s"), 0.0)
    plan.add(entry(fault="flicker", at="1 s"), 0.0)
    assert plan.tick(1.0) == ["lamp: dark: fault 'dark' takes much"]
    assert list(lamp.shown) == ["flicker"]
    assert plan.tick(2.0) == []


def test_a_fault_file_is_read_with_its_units(tmp_path: Path) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(
        "faults:\n"
        "  - {part: wheel_servo, fault: emergency, options: {code: 0x2310}, at: 2 s}\n"
        "  - part: carriage\n"
        "    fault: tpdo_stale\n"
        "    when: carriage.position > 500 mm\n"
        "    for: 250 ms\n"
    )
    first, second = read_fault_file(path)
    assert (first.at, first.for_, first.options) == (2.0, None, {"code": 0x2310})
    assert (second.when, second.for_) == ("carriage.position > 500 mm", 0.25)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("faults:\n  - {part: a, fault: b}\n  - {part: a}\n", r":3:5: fault: Field required"),
        ("faults:\n  - {part: a, fault: b, at: 2}\n", r":2:5: at: .*write '2 s'"),
        ("faults:\n  - {part: a, fault: b, until: 2 s}\n", r":2:5: until: Extra inputs"),
        ("faults:\n  - {part: a, fault: b, when: hot}\n", r":2:5: .*cannot read 'hot'"),
        ("faults:\n  - {part: a, fault: b, probability: 1 1/s}\n", r":2:5: .*needs `for`"),
        ("- {part: a, fault: b}\n", "expected a list under `faults:`"),
        ("faults: [\n", "is not closed"),
    ],
)
def test_wrong_fault_file_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        read_fault_file(path)
