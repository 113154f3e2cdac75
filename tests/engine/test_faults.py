"""Faults that a procedure shows: checked before arming, recorded, ended with the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest
from support.engine.bench import Axis, Bench, move, procedure

from rigd.engine.run.faults import ShownFaults
from rigd.model.errors import Blocked, Exit, LinkError
from rigd.procedure.program import Fault


@dataclass
class Simulation:
    """Knows one device with one fault, and refuses options."""

    asked: list[Mapping[str, Any]] = field(default_factory=list)
    gone: bool = False

    def ask(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        if self.gone:
            raise LinkError("no simulation answers at /tmp/control")
        self.asked.append(request)
        if request.get("options"):
            raise ValueError("fault 'silent' takes no option")
        return {"parts": {"scale": {"silent": "says nothing"}}}


class Sensor(Axis):
    """A device that takes no setpoints."""

    setpoints = ()


def sound_bench() -> Bench:
    """A bench on which nothing fails by itself."""
    return Bench(other=Sensor())  # type: ignore[arg-type]  # any axis will do


SILENT = Fault("scale", "silent", 0.1, 2.0)


def test_fault_is_shown_between_two_steps_and_recorded() -> None:
    bench, simulation = sound_bench(), Simulation()
    faults = ShownFaults(simulation.ask)
    result = bench.run(procedure([move("one", 0.1), SILENT, move("two", 0.1)]), faults=faults)
    assert result.execute().exit_code is Exit.OK
    assert [item["do"] for item in simulation.asked] == ["faults", "fault"]
    assert simulation.asked[1] == {
        "do": "fault", "part": "scale", "fault": "silent", "options": {}, "after_s": 0.1,
        "for_s": 2.0,
    }  # fmt: skip
    told = [(kind, data.get("name", data.get("fault"))) for _, kind, _, data in bench.sink.events
            if kind in ("step", "fault_shown")]  # fmt: skip
    assert told[:3] == [("step", "one"), ("fault_shown", "silent"), ("step", "two")]
    faults.clear()
    assert simulation.asked[2:] == [{"do": "clear", "part": "scale", "fault": "silent"}]
    faults.clear()  # twice is silent
    assert len(simulation.asked) == 3


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (Fault("scales", "silent"), "no device 'scales' that could fail: did you mean 'scale'?"),
        (Fault("scale", "silnt"), "scale cannot show the fault 'silnt': did you mean 'silent'?"),
    ],
)
def test_fault_unknown_to_simulation_is_refused_before_arming(fault: Fault, told: str) -> None:
    bench = sound_bench()
    run = bench.run(procedure([move("one", 0.1), fault]), faults=ShownFaults(Simulation().ask))
    with pytest.raises(Blocked, match=told[:20]) as error:
        run.execute()
    assert any(told in reason for reason in error.value.reasons)
    assert bench.sink.steps() == []


def test_without_a_simulation_nothing_is_armed() -> None:
    bench, simulation = sound_bench(), Simulation(gone=True)
    run = bench.run(procedure([move("one", 0.1), SILENT]), faults=ShownFaults(simulation.ask))
    with pytest.raises(Blocked, match="no simulation answers"):
        run.execute()
    assert bench.sink.steps() == []


def test_options_refused_by_simulation_end_the_run() -> None:
    bench = sound_bench()
    wrong = Fault("scale", "silent", options={"count": 1})
    run = bench.run(
        procedure([move("one", 0.1), wrong, move("two", 0.1)]),
        faults=ShownFaults(Simulation().ask),
    )
    result = run.execute()
    assert result.exit_code is Exit.FAILED
    assert "fault 'silent' of scale: fault 'silent' takes no option" in result.reason
    assert "two" not in bench.sink.steps()


def test_a_simulation_that_has_ended_needs_no_clearing() -> None:
    simulation = Simulation()
    faults = ShownFaults(simulation.ask)
    faults.show(SILENT)
    simulation.gone = True
    faults.clear()
