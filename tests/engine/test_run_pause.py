"""Pausing a run, and asking it to end after the trial under way."""

from __future__ import annotations

from support.engine.bench import Bench, move, procedure

from rigd.engine.run.result import Progress
from rigd.model.states import RunState


def test_pause_waits_for_trial_end_and_rests_rig() -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5, 2.0)], [move("two", 0.5)]))
    states: list[RunState] = []
    speeds_while_paused: list[float] = []

    def operator(progress: Progress) -> None:
        states.append(progress.state)
        if progress.run_s > 0.9 and RunState.PAUSING not in states:
            bench.control.pause_wanted = True
        if progress.state is RunState.PAUSED:
            run.host.settle(10)
            speeds_while_paused.append(bench.axis.speed)
            bench.control.pause_wanted = False

    run.watch = operator
    run.execute()
    assert bench.sink.steps() == ["one", "two", "home"]
    order = [s for s in states if s in (RunState.PAUSING, RunState.PAUSED)]
    assert order[0] is RunState.PAUSING
    assert order[-1] is RunState.PAUSED
    assert speeds_while_paused == [0.0]


def test_run_can_be_asked_to_end_after_trial() -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5, 1.0)], [move("two", 0.5)], after=[move("b", -0.5)]))

    def vanish(progress: Progress) -> None:
        if progress.trial is not None:
            bench.control.end_after_trial("nobody is there")

    run.watch = vanish
    result = run.execute()
    assert bench.sink.steps() == ["one", "b", "home"]
    assert (result.ending, result.reason, result.trials_done) == ("stopped", "nobody is there", 1)


def test_paused_run_ends_after_its_trial_on_request() -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5, 1.0)], [move("two", 0.5)]))

    def vanish(progress: Progress) -> None:
        if progress.trial is not None:
            bench.control.pause_wanted = True
        if progress.state is RunState.PAUSED:
            bench.control.end_after_trial("nobody is there")

    run.watch = vanish
    result = run.execute()
    assert bench.sink.steps() == ["one", "home"]
    assert result.ending == "stopped"


def test_request_to_end_after_trial_can_be_withdrawn() -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5, 1.0)], [move("two", 0.5)]))

    def change_of_mind(progress: Progress) -> None:
        if progress.trial is None or progress.trials_done:
            return
        if progress.run_s < 0.5:
            bench.control.end_after_trial("nobody is there")
        else:
            bench.control.resume()

    run.watch = change_of_mind
    assert run.execute().ending != "stopped"
    assert bench.sink.steps() == ["one", "two", "home"]
