"""One execution of a procedure on a rig, from preflight to a safe rig and a finished file.

``finish`` and ``make_safe`` are two things: ``finish`` may move (bring the carriage home) and
plays only where nothing went wrong with the rig itself; ``make_safe`` never moves anything on
purpose and runs on every way out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial

from rigd.engine.answers import Answers
from rigd.engine.asking import Asking, ChangePlant
from rigd.engine.clock import idle
from rigd.engine.control import Control
from rigd.engine.cycle import ENDING_OF_VERB
from rigd.engine.faults import ShownFaults
from rigd.engine.host import Host
from rigd.engine.player import Ending, Outcome
from rigd.engine.preflight import IdentityCheck, preflight
from rigd.engine.result import Progress, RunResult, ending_word
from rigd.model.errors import Blocked, Exit, RigdError
from rigd.model.states import RunEvent, RunState, next_state
from rigd.procedure.program import (
    CompiledProcedure,
    CycleProgram,
    Fault,
    Prompt,
    Step,
    TrialPlan,
)
from rigd.record.events import NO_TRIAL

#: Beyond this share of missed cycles a recording is not what it looks like.
MISSED_SHARE = 0.05


@dataclass
class _WayOut(Exception):
    """Leaves the sequence: why, and whether `finish` may still move the rig."""

    outcome: Outcome
    exit_code: Exit
    final: RunEvent
    may_finish: bool


@dataclass
class Run:
    """Plays ``procedure`` on the rig behind ``host``.

    ``done`` holds the numbers of trials that an earlier, interrupted run has completed.
    ``change`` is None for a real rig, ``faults`` for one that is not simulated at the wire.
    """

    procedure: CompiledProcedure
    host: Host
    control: Control
    answers: Answers
    change: ChangePlant | None = None
    faults: ShownFaults | None = None
    done: frozenset[int] = frozenset()
    watch: Callable[[Progress], None] = lambda _: None
    extra_checks: Sequence[Callable[[], Sequence[str]]] = ()
    identity_check: IdentityCheck = lambda _: ()
    state: RunState = RunState.IDLE
    _trial: TrialPlan | None = None
    _trials_done: int = field(init=False)
    _asking: Asking = field(init=False)
    _aborted: bool = False
    _incomplete: list[tuple[int, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._asking = Asking(self.host, self.answers, self.change)
        self._trials_done = len(self.done)  # from the start: one may end before the next trial

    @property
    def progress(self) -> Progress:
        """Where the run stands now."""
        return Progress(
            self.state,
            self.host.segment,
            self._trials_done,
            len(self.procedure.trials),
            self._trial,
            self.host.run_s,
            tuple(self.host.trips),
        )

    def execute(self) -> RunResult:
        """Run the procedure; on every way out the rig is made safe and the sink closed.

        Raises:
            Blocked: preflight refused; nothing moved.
            RigdError: the recording could not be kept, or a driver failed outside the cycle; the
                rig is safe when this is raised.
        """
        self.host.on_drain = self._look_around
        reason, code = "interrupted", Exit.INTERNAL
        try:
            reason, code = self._live()
        except RigdError as error:
            reason = error.message
            if next_state(self.state, RunEvent.FAULT) is not None:
                self._to(RunEvent.FAULT)
            raise
        except BaseException as error:
            reason = f"{type(error).__name__}: {error}"
            raise
        finally:
            # In this order: nothing that can fail or take time comes before a safe rig.
            problems = self.host.make_safe()
            try:
                self._end(ending_word(code, self.state, aborted=self._aborted), reason)
            finally:
                self.host.close()
        return self._result(reason, code, problems)

    def _live(self) -> tuple[str, Exit]:
        self._to(RunEvent.CHECK)
        try:
            checks = [*self.extra_checks]
            if self.faults is not None:
                checks.append(partial(self.faults.unknown, self.procedure))
            stopped = preflight(
                self.host, self.procedure, self.answers, checks, self.identity_check
            )
        except Blocked as error:
            verb = self.control.verb
            if verb is None:
                self._to(RunEvent.BLOCK)
                raise
            stopped = Outcome(ENDING_OF_VERB[verb], f"{self.control.reason} ({error.message})")
        if stopped is not None:
            return self._end_early(stopped)
        self._event("run_start", {"procedure": self.procedure.name, "resumed": bool(self.done)})
        failed = self.host.arm()
        if failed is not None:
            return self._end_early(failed)
        self._to(RunEvent.ARM)
        self._to(RunEvent.START)
        reason, code, final = "all trials played", Exit.OK, RunEvent.FINISHED
        may_finish = True
        try:
            self._sequence()
            self._to(RunEvent.COMPLETE)
        except _WayOut as out:
            reason, code, final = out.outcome.reason, out.exit_code, out.final
            may_finish = out.may_finish
        barred = self.host.ends_everything()
        if barred and may_finish:
            may_finish, code, final = False, Exit.TRIPPED, RunEvent.FAULT
            reason = reason if barred in reason else f"{reason}; {barred}"
        elif may_finish and self.state is not RunState.FINISHING:
            self._to(RunEvent.STOP)
            self._to(RunEvent.STOPPED)
        if may_finish:
            try:
                self._play_steps(self.procedure.finish, "finish")
                outcome = self.host.come_to_rest()  # at the rates of the rig file, then safe
                if outcome is not None:
                    raise self._way_out(outcome)
            except _WayOut as out:
                # What went wrong first is what the operator must hear; worse only adds to it.
                reason = (
                    f"{reason}; in finish: {out.outcome.reason}" if code else out.outcome.reason
                )
                code = out.exit_code if code in (Exit.OK, Exit.STOPPED) else code
                final = RunEvent.FINISHED if out.may_finish else out.final
        if final in (RunEvent.FAULT, RunEvent.ESTOP):
            self._to(final)
        elif final is RunEvent.ABORT:
            self._aborted = True
            self._to(RunEvent.ABORT)
            self._to(RunEvent.SAFE)
        else:
            self._to(RunEvent.FINISHED)
        if code is Exit.OK:
            return self._judge(reason)
        return reason, code

    def _end_early(self, outcome: Outcome) -> tuple[str, Exit]:
        """End before anything has moved: there is nothing to finish."""
        out = self._way_out(outcome)
        if out.final is RunEvent.ABORT:
            self._aborted = True
            self._to(RunEvent.ABORT)
            self._to(RunEvent.SAFE)
        else:
            self._to(RunEvent.STOP if out.final is RunEvent.FINISHED else out.final)
        return outcome.reason, out.exit_code

    def _judge(self, reason: str) -> tuple[str, Exit]:
        """Return what to call a run that came to its end but is not what was asked for."""
        counters = self.host.counters
        if counters.missed > MISSED_SHARE * (counters.cycles + counters.missed):
            share = 100 * counters.missed / (counters.cycles + counters.missed)
            return f"{share:.0f} % of the cycles were missed: run at a lower pace", Exit.FAILED
        if self._incomplete:
            early = len(self._incomplete)
            return f"{early} of {len(self.procedure.trials)} trials ended early", Exit.FAILED
        return reason, Exit.OK

    def _sequence(self) -> None:
        self._play_steps(self.procedure.prepare, "prepare")
        for trial in self.procedure.trials:
            if trial.number in self.done:
                continue
            self._between_trials()
            barred = self.host.ends_everything()
            if barred:
                raise self._way_out(Outcome(Ending.FAULTED, barred))
            self._play_trial(trial)
            self._trials_done += 1

    def _look_around(self) -> None:
        """Between two cycles: show progress, and show that a pause was asked for."""
        if self.control.pause_wanted and self.state is RunState.RUNNING:
            self._to(RunEvent.PAUSE)
        elif not self.control.pause_wanted and self.state is RunState.PAUSING:
            self._to(RunEvent.RESUME)
        else:
            self.watch(self.progress)

    def _between_trials(self) -> None:
        """Wait here while a pause is wanted; end here where no trial is to follow."""
        if self.control.pauses:
            if self.state is RunState.RUNNING:
                self._to(RunEvent.PAUSE)
            self._to(RunEvent.TRIAL_ENDED)
            outcome = self.host.rest_while(self._still_paused)
            if outcome is not None:
                raise self._way_out(outcome)
            self._to(RunEvent.RESUME)
        if self.control.last_trial:
            raise self._way_out(Outcome(Ending.STOPPED, self.control.last_trial))

    def _still_paused(self) -> bool:
        if self.host.virtual:
            idle(0.05)
        return self.control.pauses

    def _play_trial(self, trial: TrialPlan) -> None:
        self._trial = trial
        self.host.trial = trial.number
        parameters = dict(trial.parameters)
        self._event(
            "trial_start",
            {
                "number": trial.number,
                "repeat": trial.repeat,
                "parameters": parameters,
                "units": {k: u for k, u in self.procedure.units.items() if k in parameters},
            },
        )
        complete, reason = False, "interrupted"
        try:
            outcome = self._play(trial.steps, trial.after)
            complete = outcome.ending is Ending.DONE
            reason = outcome.reason or "all steps played"
            ends_run = outcome.trip is not None and outcome.trip.interlock.latch
            if outcome.ending is Ending.TRIAL_ENDED and not ends_run:
                self._incomplete.append((trial.number, outcome.reason))
            elif outcome.ending is not Ending.DONE:
                raise self._way_out(outcome)
            self._play_steps(trial.after, "after")
        except _WayOut as out:
            complete, reason = False, out.outcome.reason
            raise
        finally:
            self.host.drain()
            self._event("trial_end", {"complete": complete, "reason": reason})
            self._trial = None
            self.host.trial = NO_TRIAL

    def _play_steps(self, steps: Sequence[Step], block: str) -> None:
        """Play a block in which nothing may end early."""
        outcome = self._play(steps)
        if outcome.ending is Ending.DONE:
            return
        if outcome.ending is Ending.TRIAL_ENDED:
            outcome = Outcome(Ending.FAILED, f"{block}: {outcome.reason}", outcome.trip)
        raise self._way_out(outcome)

    def _play(self, steps: Sequence[Step], after: Sequence[Step] = ()) -> Outcome:
        """Play ``steps``; the first of ``after`` follows the last one without a gap."""
        for step, following in zip(steps, [*steps[1:], *after[:1], None], strict=False):
            if isinstance(step, Prompt):
                outcome = self._asking.ask(step)
                if outcome is not None:
                    return outcome
            elif isinstance(step, Fault):
                outcome = self._show(step)
                if outcome is not None:
                    return outcome
            else:
                then = following if isinstance(following, CycleProgram) else None
                outcome = self.host.play(step, then)
                if outcome.ending is not Ending.DONE:
                    return outcome
        return Outcome(Ending.DONE)

    def _show(self, fault: Fault) -> Outcome | None:
        """Let a simulated device show a fault; the setpoints stay as they are."""
        if self.faults is None:
            raise RuntimeError("a fault step was compiled for a rig that shows no faults")
        try:
            self.faults.show(fault)
        except ValueError as error:
            return Outcome(Ending.FAILED, f"fault {fault.fault!r} of {fault.part}: {error}")
        self._event("fault_shown", asdict(fault))
        return None

    def _way_out(self, outcome: Outcome) -> _WayOut:
        """Return where ``outcome`` leads, and whether the rig may still be moved."""
        trip = outcome.trip
        latched = trip is not None and trip.interlock.latch
        match outcome.ending:
            case Ending.FAULTED:
                return _WayOut(outcome, Exit.TRIPPED, RunEvent.FAULT, may_finish=False)
            case Ending.ESTOPPED:
                code = Exit.STOPPED if trip is None else Exit.TRIPPED
                return _WayOut(outcome, code, RunEvent.ESTOP, may_finish=False)
            case Ending.ABORTED:
                code = Exit.STOPPED if trip is None else Exit.TRIPPED
                return _WayOut(outcome, code, RunEvent.ABORT, may_finish=False)
            case Ending.STOPPED if trip is None:
                return _WayOut(outcome, Exit.STOPPED, RunEvent.FINISHED, may_finish=True)
            case Ending.STOPPED | Ending.TRIAL_ENDED | Ending.FAILED if trip is not None:
                final = RunEvent.FAULT if latched else RunEvent.FINISHED
                return _WayOut(outcome, Exit.TRIPPED, final, may_finish=not latched)
            case _:
                return _WayOut(outcome, Exit.FAILED, RunEvent.FINISHED, may_finish=True)

    def _to(self, event: RunEvent) -> None:
        """Move on in the table of states; an event the table refuses is a bug here."""
        state = next_state(self.state, event)
        if state is None:
            raise RuntimeError(f"run state {self.state.name} has no way out by {event.name}")
        if state is not self.state:
            self.state = state
            self.watch(self.progress)

    def _event(self, kind: str, data: Mapping[str, object]) -> None:
        self.host.event(kind, data)

    def _end(self, ending: str, reason: str) -> None:
        """Record how the run ended, as far as the sink still takes anything."""
        self.host.drain()
        self._event(
            "run_end",
            {
                "state": ending,
                "reason": reason,
                "trials_done": self._trials_done,
                "trials_total": len(self.procedure.trials),
                "missed_cycles": self.host.counters.missed,
                "stale_rows": self.host.counters.stale,
                "overruns": self.host.overruns,
            },
        )

    def _result(self, reason: str, code: Exit, problems: Sequence[str]) -> RunResult:
        return RunResult(
            self.state,
            ending_word(code, self.state, aborted=self._aborted),
            reason,
            Exit.TRIPPED if problems else code,
            self._trials_done,
            len(self.procedure.trials),
            self.progress.run_s,
            tuple(self._incomplete),
            self.host.counters.cycles,
            self.host.counters.missed,
            tuple(
                f"{trip.interlock.name} ({trip.interlock.action.name.lower()}): {trip.reason}"
                + (f" - {trip.message}" if trip.message else "")
                for trip in self.host.trips
            ),
            tuple(problems),
        )
