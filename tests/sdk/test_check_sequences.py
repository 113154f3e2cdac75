"""Random sequences of calls: what counts as a failure, and what could not be judged is stated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count

import pytest
from support.instruments.memory_motor import Good, motor

from rigd.model.errors import LinkError, ProtocolError
from rigd.sdk.check import examine_driver
from rigd.sdk.check.sequences import (
    PLAYS,
    DrawnStep,
    DrawnTrial,
    StepFailed,
    first_failure,
)

TRIALS = [DrawnTrial((DrawnStep("open"), DrawnStep("write", number)), {}) for number in range(5)]


def examined(play: Callable[[int], None]) -> tuple[Sequence[str], Sequence[str]]:
    """Findings and notes of five trials; ``play`` gets what is written, 0 to 4."""
    notes: list[str] = []

    def made(trial: DrawnTrial) -> None:
        for step in trial.steps:
            if step.name == "write":
                play(step.value)

    return list(first_failure(made, TRIALS, notes)), notes


def doubtful(problem: str) -> StepFailed:
    """Return a failure that this machine may have made."""
    failed = StepFailed(problem)
    failed.doubtful = True
    return failed


def test_failure_on_a_busy_machine_counts_each_time() -> None:
    def play(number: int) -> None:
        if number == 2:
            raise doubtful("it drives on")

    assert examined(play) == (["write 2: it drives on"], [])


@pytest.mark.parametrize("times", range(1, PLAYS))
def test_driver_that_passes_on_busy_machine_is_right(times: int) -> None:
    failing = iter([doubtful("a row is old")] * times)

    def play(number: int) -> None:
        for failed in failing:
            raise failed

    findings, (note,) = examined(play)
    assert findings == []
    assert note.startswith("while this machine was busy, showed ")


def test_failures_while_machine_goes_on_count_twice() -> None:
    failing = iter([doubtful("a row is old"), *[StepFailed("it drives on")] * 20])

    def play(number: int) -> None:
        for failed in failing:
            raise failed

    assert examined(play) == (["write 0: it drives on"], [])


def test_failure_that_shows_only_once_is_stated() -> None:
    failing = iter([StepFailed("it drives on")])

    def play(number: int) -> None:
        for failed in failing:
            raise failed

    assert examined(play) == ([], ["showed once in 4 times: open, write 0: it drives on"])


def test_failure_that_shows_now_and_then_is_finding() -> None:
    times = count()

    def play(number: int) -> None:
        if next(times) % 3 == 0:
            raise StepFailed("it drives on")

    assert examined(play) == (["open, write 0: it drives on"], [])


class Choosy(Good):
    """Opens with the range of its author alone, else it raises."""

    error: Exception

    def open(self) -> None:
        if self.config.speed_range != 2.0:
            raise self.error


@pytest.mark.parametrize("error", [KeyError("gain"), LinkError("no")])
def test_drawn_options_excuse_no_other_error_at_open(error: Exception) -> None:
    wrong = type("Wrong", (Choosy,), {"error": error, "__doc__": "Wrong."})
    report = examine_driver(wrong, peer=motor, only=["any order of calls"])
    (finding,) = report.findings
    assert f"open raises {type(error).__name__}" in finding.problem
    assert "with speed_range: " in finding.problem


def test_device_that_is_not_as_drawn_is_stated() -> None:
    error = ProtocolError("it is a motor for 2 m/s")
    right = type("Right", (Choosy,), {"error": error, "__doc__": "Right."})
    report = examine_driver(right, peer=motor, only=["any order of calls"])
    assert report.findings == ()
    assert "trials were not judged: with speed_range: " in str(report)
    assert "open raises ProtocolError: it is a motor for 2 m/s" in str(report)
