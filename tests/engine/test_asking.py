"""A prompt is put until its answer can be and the rig shows it; nothing moves before that."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import pytest
from support.engine.bench import Axis, AxisRow, Bench, move, procedure

from rigd.engine.run.answers import AnswerRefused, Answers, OwnAnswers, check_answer, read_answer
from rigd.engine.run.result import Progress, RunResult
from rigd.engine.run.run import Run
from rigd.model.errors import Exit
from rigd.model.severity import Severity
from rigd.procedure.program import (
    Agreement,
    Answer,
    AnswerKind,
    Comparison,
    Condition,
    Prompt,
    StatusCondition,
)
from rigd.sdk import Declaration, DriverConfig

STABLE, OVERLOAD = 1, 2


class WeighedRow(AxisRow):
    status: int


class WeighingAxis(Axis):
    """An axis whose load is shown with a status word; a new load is stable after a while."""

    def __init__(self, stable_after_cycles: int = 0) -> None:
        super().__init__()
        self._stable_after = stable_after_cycles
        self._since = 0
        self._shown = self.load

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        bits = {"stable": STABLE, "overload": OVERLOAD}
        return replace(super().declare(config), row=WeighedRow, status_bits=bits)

    def read(self, t_ns: int) -> Sequence[float]:
        super().read(t_ns)
        self._since = 0 if self.load != self._shown else self._since + 1
        self._shown = self.load
        status = STABLE if self._since >= self._stable_after else 0
        return WeighedRow.of(position=self.position, load=self.load, status=status)


@dataclass
class Person:
    """Answers with ``replies``, one after the other; each may do something first."""

    replies: Iterator[Callable[[], Answer]]
    objections: list[str] = field(default_factory=list)
    by: str = "operator"
    asks_again: bool = True
    withdrawn: int = 0  #: times that a question was put no longer

    def can_answer(self, prompt: Prompt) -> bool:
        return True

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        self.objections.append(objection)
        return next(self.replies)()

    def withdraw(self) -> None:
        self.withdrawn += 1


def _same(answer: Answer) -> Answer:
    return answer


def says(*answers: Answer) -> Person:
    return Person(iter([partial(_same, answer) for answer in answers]))


def load_prompt() -> Prompt:
    stable = StatusCondition("axis", "stable", STABLE)
    return Prompt(
        "load",
        "Put 5 N on it.",
        AnswerKind.NUMBER,
        unit="N",
        low=1.0,
        high=9.0,
        answer=5.0,
        changes="load",
        agrees=Agreement("axis.load", 0.05, True, for_s=0.1, stable=stable),
        timeout_s=0.5,
    )


def run(
    bench: Bench,
    prompt: Prompt,
    answers: Answers | None = None,
    change: Callable[[str, float | str], None] | None = None,
) -> RunResult:
    trials = procedure([prompt, move("drive", 0.5)])
    asked = answers or OwnAnswers()
    return Run(trials, bench.host(), bench.control, asked, change=change).execute()


def data_of(bench: Bench, kind: str) -> list[Mapping[str, object]]:
    return [data for _, event, _, data in bench.sink.events if event == kind]


def putting_on(bench: Bench, share: float = 1.0) -> Callable[[str, float | str], None]:
    """The simulated rig puts on ``share`` of what was announced."""

    def change(quantity: str, value: float | str) -> None:
        assert quantity == "load"
        bench.axis.load = share * float(value)

    return change


def test_shown_value_is_awaited_at_rest_and_recorded() -> None:
    bench = Bench(axis=WeighingAxis(stable_after_cycles=250))
    run(bench, load_prompt(), change=putting_on(bench, 1.02))
    assert bench.sink.steps() == ["load", "drive", "home"]
    (checked,) = data_of(bench, "answer_checked")
    assert (checked["answer"], checked["agreed"]) == (5.0, True)
    assert checked["shown"] == {"axis.load": 5.1, "axis.status": STABLE}
    begun = {data["name"]: t_ns for t_ns, kind, _, data in bench.sink.events if kind == "step"}
    assert begun["drive"] - begun["load"] >= 250_000_000  # as long as it was not stable
    moving = next(index for index, speed in enumerate(bench.axis.written) if speed)
    assert moving > 250


def test_file_answer_contradicted_by_rig_fails_the_run() -> None:
    bench = Bench(axis=WeighingAxis())
    result = run(bench, load_prompt(), change=putting_on(bench, 0.804))
    assert result.ending == "incomplete"
    assert result.reason == (
        "prompt 'load': the answer was 5 N, but axis.load is 4.02 N, axis is stable "
        "(checked for 0.5 s, expected 4.75 N to 5.25 N)"
    )
    assert bench.sink.steps() == ["load", "home"]
    assert data_of(bench, "answer_checked")[0]["agreed"] is False
    assert [data["complete"] for data in data_of(bench, "trial_end")] == [False]


def test_person_sees_the_reading_and_is_asked_again() -> None:
    bench = Bench(axis=WeighingAxis())
    bench.axis.load = 4.02
    person = says(5.0, 4.0)
    run(bench, load_prompt(), person)
    assert person.objections[0] == ""
    assert "the answer was 5 N, but axis.load is 4.02 N" in person.objections[1]
    assert [data["answer"] for data in data_of(bench, "answer")] == [5.0, 4.0]
    assert [data["agreed"] for data in data_of(bench, "answer_checked")] == [False, True]
    assert "axis.load is 4.02 N" in str(data_of(bench, "prompt")[1]["objection"])
    assert bench.sink.steps() == ["load", "load", "drive", "home"]


def test_typed_answer_is_recorded_beside_the_planned_one() -> None:
    bench = Bench(axis=WeighingAxis())
    bench.axis.load = 5.5
    run(bench, load_prompt(), says(5.6))  # 5.5 N is 10 % from the plan, 2 % from the answer
    (answer,) = data_of(bench, "answer")
    assert (answer["answer"], answer["planned"], answer["changes"]) == (5.6, 5.0, "load")
    assert answer["by"] == "operator"
    assert "drive" in bench.sink.steps()


def test_reading_never_at_rest_agrees_with_nothing() -> None:
    bench = Bench(axis=WeighingAxis(stable_after_cycles=10_000))
    result = run(bench, load_prompt(), change=putting_on(bench))
    assert "axis.load is 5 N, axis is not stable" in result.reason
    assert "drive" not in bench.sink.steps()


def test_the_distance_may_be_a_quantity() -> None:
    bench = Bench(axis=WeighingAxis())
    bench.axis.load = 0.05
    distance = Agreement("axis.load", 0.1, False)
    run(bench, replace(load_prompt(), low=0.0, answer=0.0, agrees=distance))
    assert "drive" in bench.sink.steps()


def test_condition_is_checked_once_person_confirms() -> None:
    bench = Bench()
    bench.axis.position = 0.3

    def push_back() -> bool:
        bench.axis.position = 0.0
        return True

    person = Person(iter([lambda: True, push_back]))
    at_start = Condition("axis.position", Comparison.BELOW, 0.02, magnitude=True, unit="m")
    run(bench, Prompt("push_back", "Push it back.", until=((at_start,),), timeout_s=0.2), person)
    assert person.objections[1] == (
        "prompt 'push_back': axis.position is 0.3 m "
        "(checked for 0.2 s, expected |axis.position| < 0.02 m)"
    )
    assert bench.sink.steps() == ["push_back", "push_back", "drive", "home"]


def test_answer_out_of_bounds_is_asked_again() -> None:
    bench = Bench(axis=WeighingAxis())

    def change(quantity: str, value: float | str) -> None:
        if float(value) > 6.0:
            raise ValueError("the simulated rig holds 6 N at most")
        putting_on(bench)(quantity, value)

    person = says(20.0, 8.0, 5.0)
    run(bench, load_prompt(), person, change)
    assert "20 N is outside 1 N .. 9 N" in person.objections[1]
    assert "holds 6 N at most" in person.objections[2]
    assert "drive" in bench.sink.steps()


def test_answer_rounded_beyond_bound_is_bound() -> None:
    prompt = Prompt("way", "How far?", AnswerKind.NUMBER, unit="m", low=0.3, high=0.57)
    assert check_answer(prompt, read_answer(prompt, "570 mm")) == 0.57
    assert check_answer(prompt, 0.3 * (1 - 1e-15)) == 0.3
    with pytest.raises(AnswerRefused, match=r"0.571 m is outside 0.3 m .. 0.57 m"):
        check_answer(prompt, read_answer(prompt, "571 mm"))


def test_no_ends_the_run_without_a_second_question() -> None:
    bench = Bench()
    person = says(False)
    result = run(bench, Prompt("clear", "Is it clear?"), person)
    assert "declined" in result.reason
    assert len(person.objections) == 1
    assert bench.sink.steps() == ["home"]


def test_question_that_something_else_has_ended_is_withdrawn() -> None:
    bench, asked = Bench(), threading.Event()

    def wait() -> Answer:
        bench.control.request(Severity.STOP, "button")
        asked.wait(30)
        return True

    person = Person(iter([wait]))
    result = run(bench, Prompt("clear", "Is it clear?"), person)
    asked.set()
    assert (result.ending, result.reason) == ("stopped", "button")
    assert person.withdrawn == 1


def test_person_can_stop_while_rig_is_looked_at() -> None:
    bench = Bench(axis=WeighingAxis())
    made = bench.run(procedure([replace(load_prompt(), timeout_s=60.0), move("drive", 0.5)]))

    def press(progress: Progress) -> None:
        if progress.step == "load":
            bench.control.request(Severity.STOP, "button")

    made.watch = press
    result = made.execute()
    assert (result.ending, result.reason) == ("stopped", "button")
    assert not data_of(bench, "answer_checked")


@pytest.mark.parametrize(("agrees", "code"), [(True, Exit.OK), (False, Exit.FAILED)])
def test_agreement_of_answer_decides_exit_code(agrees: bool, code: Exit) -> None:
    bench = Bench(axis=WeighingAxis())
    bench.other.make_safe = lambda: None  # type: ignore[method-assign]
    result = run(bench, load_prompt(), change=putting_on(bench, 1.0 if agrees else 0.5))
    assert result.exit_code is code
