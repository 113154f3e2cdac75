"""Runs a procedure once on a rig: preflight, arm, trials, finish, make safe.

``finish`` and ``make_safe`` are different. ``finish`` may move the rig (for example, bring the
carriage home) and plays only if the rig itself has no fault. ``make_safe`` never moves anything on
purpose and runs on every way out of a run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from math import isnan

from rigd.config.rig import RestBound, Supervision
from rigd.engine.clock import idle
from rigd.engine.play.control import Control
from rigd.engine.play.player import Outcome
from rigd.engine.run.answers import Answers, Given, GivenBefore
from rigd.engine.run.asking import Asking, ChangePlant
from rigd.engine.run.faults import ShownFaults
from rigd.engine.run.host import Host
from rigd.engine.run.preflight import IdentityCheck, preflight
from rigd.engine.run.result import Progress, RunResult
from rigd.engine.run.trial_judgement import TrialJudge
from rigd.model.errors import Blocked, Exit, RigdError
from rigd.model.severity import BLOCKED, BROKEN, WAYS_OUT, Severity, WayOut
from rigd.model.states import RunEvent, RunState, next_state
from rigd.model.units import format_quantity
from rigd.procedure.program import (
    CompiledProcedure,
    CycleProgram,
    Fault,
    Prompt,
    Step,
    TrialPlan,
)
from rigd.record.events.event import NO_TRIAL

#: With more missed cycles than this share, a recording is not reliable.
MISSED_SHARE = 0.05


@dataclass
class Run:
    """Plays ``procedure`` on the rig behind ``host``.

    ``done`` are the numbers of trials that an earlier, interrupted run has completed. In virtual
    time they are simulated again, unrecorded, with the answers ``given`` (by trial): what follows
    then is bit for bit as if nothing had interrupted the run. ``draw`` gets the seed of each trial
    that begins, by number in ``seeds``: the plant of a simulated rig draws from it. ``change`` is
    None for a real rig, ``faults`` for a rig that is not simulated at the wire. ``judge`` evaluates
    each trial that has ended, if the procedure asks for it. ``supervision`` states how long rows
    go on after a run that did not reach its end.
    """

    procedure: CompiledProcedure
    host: Host
    control: Control
    answers: Answers
    change: ChangePlant | None = None
    faults: ShownFaults | None = None
    draw: Callable[[int], None] = lambda _: None
    seeds: Mapping[int, int] = field(default_factory=dict)
    done: frozenset[int] = frozenset()
    given: Mapping[int, Sequence[Given]] = field(default_factory=dict)
    watch: Callable[[Progress], None] = lambda _: None
    judge: TrialJudge | None = None
    supervision: Supervision = field(default_factory=Supervision)
    extra_checks: Sequence[Callable[[], Sequence[str]]] = ()
    identity_check: IdentityCheck = lambda _: ()
    state: RunState = RunState.IDLE
    _trial: TrialPlan | None = None
    _begun_s: float | None = None  #: time of the host when the preflight was passed
    _end_s: float | None = None  #: time of the host when the rig had been made safe
    _ending: str = ""  #: how the run ends, once that is known
    _coming_to_rest: bool = False
    _armed: bool = False
    _waited_s: float = 0.0  #: for answers, until the present prompt
    _asked_s: float | None = None  #: time of the host when the present prompt was shown
    _trials_done: int = field(init=False)
    _asking: Asking = field(init=False)
    _played_again: bool = False  #: whether the trial before was played again, unrecorded
    _incomplete: list[tuple[int, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._asking = Asking(self.host, self.answers, self.change)
        self._trials_done = len(self.done)  # from the start: the run may end before the next trial

    @property
    def progress(self) -> Progress:
        """The present progress of the run."""
        return Progress(
            self.state,
            self.host.segment,
            self._trials_done,
            len(self.procedure.trials),
            self._trial,
            0.0 if self._begun_s is None else (self._end_s or self.host.run_s) - self._begun_s,
            tuple(self.host.trips),
            self._waited_s + self._waiting_s,
            self._ending,
            self._coming_to_rest,
        )

    @property
    def _waiting_s(self) -> float:
        """How long a person has been awaited for the present prompt."""
        return 0.0 if self._asked_s is None else self.host.run_s - self._asked_s

    def execute(self) -> RunResult:
        """Run the procedure; however it ends, the rig is made safe and the sink closed.

        Raises:
            Blocked: preflight refused; nothing moved.
            RigdError: the recording failed, or a driver failed outside the cycle; the
                rig is safe when this is raised.
        """
        self.host.on_drain = self._report_progress
        way, reason = BROKEN, "interrupted"
        try:
            way, reason = self._live()
        except RigdError as error:
            reason = error.message
            if self.state is RunState.BLOCKED:
                way = BLOCKED
            elif next_state(self.state, RunEvent.FAULT) is not None:
                self._apply(RunEvent.FAULT)
            raise
        except BaseException as error:
            reason = f"{type(error).__name__}: {error}"
            raise
        finally:
            # In this order: the rig must be safe before anything that can fail or take time.
            try:
                problems = self.host.make_safe()
                self._record_end(way.ending, reason)
                problems = (*problems, *self._read_on(way, problems))
            finally:
                self.host.close()
        return self._result(way, reason, problems)

    def _read_on(self, way: WayOut, problems: Sequence[str]) -> Sequence[str]:
        """Record on after a run that did not reach its end; return why the rig does not rest.

        With ``problems`` a device may still move, and its watchdog is to act: it is not asked.
        """
        found: list[str] = []
        self._end_s = self.host.run_s
        if self._armed and way is not BROKEN and way.exit_code is not Exit.OK:
            self._coming_to_rest = True
            self.watch(self.progress)
            began_s = self.host.run_s
            moving = self.host.read_on(self.supervision.rest_s, asking=not problems)
            after_s = self.host.run_s - began_s
            bounds = [item for item in self.supervision.at_rest if item.name in moving]
            found = [_not_at_rest(item, moving[item.name], after_s) for item in bounds]
            if self.supervision.at_rest:
                self._event("rest", {"rests": not found, "after_s": after_s, "reasons": found})
            self._coming_to_rest = False
        return found

    def _live(self) -> tuple[WayOut, str]:
        """Return how the run ended, and why; its state is then final."""
        self._apply(RunEvent.CHECK)
        outcome = self._begin()
        if outcome is not None:  # nothing has moved, so `finish` is not needed
            way, reason = outcome.way_out, outcome.reason
        else:
            outcome = self._sequence()
            way, reason = outcome.way_out, outcome.reason
            barred = self.host.lockout_reason() if way.finishes else ""
            if barred:
                way = WAYS_OUT[Severity.FAULT]
                reason = reason if barred in reason else f"{reason}; {barred}"
            if way.finishes:
                way, reason = self._finish(way, reason)
        self._ending = way.ending
        self._reach(way)
        return self._judge(reason) if way.exit_code is Exit.OK else (way, reason)

    def _begin(self) -> Outcome | None:
        """Check and arm the rig; return why it does not run, or None.

        Raises:
            Blocked: preflight refuses, and no person has stopped it.
        """
        checks = [*self.extra_checks]
        if self.faults is not None:
            checks.append(partial(self.faults.unknown, self.procedure))
        try:
            stopped = preflight(
                self.host, self.procedure, self.answers, checks, self.identity_check
            )
        except Blocked as error:
            if self.control.asked is None:
                self._apply(RunEvent.BLOCK)
                raise
            own = [item for item in error.reasons if item.startswith(self.control.reason)]
            reason = own[0] if own else f"{self.control.reason} ({error.message})"
            stopped = Outcome(self.control.asked, reason)
        if stopped is not None:
            return stopped
        self._begun_s = self.host.run_s
        self._event("run_start", {"procedure": self.procedure.name, "resumed": bool(self.done)})
        refused = self.host.arm()
        if refused is None:
            self._armed = True
            self._apply(RunEvent.ARM)
            self._apply(RunEvent.START)
        return refused

    def _finish(self, way: WayOut, reason: str) -> tuple[WayOut, str]:
        """Play `finish`; return the ending of a run that would end in ``way`` for ``reason``."""
        ends = way.exit_code is not Exit.OK
        for event in (RunEvent.STOP, RunEvent.STOPPED) if ends else (RunEvent.COMPLETE,):
            self._apply(event)
        outcome = self._play_block(self.procedure.finish, "finish")
        if outcome.severity is Severity.DONE:
            at_rest = self.host.come_to_rest()  # at the rates of the rig file, then safe
            if at_rest is None:
                return way, reason
            outcome = at_rest
        # The operator needs the first failure; a worse failure is only added to it.
        text = f"{reason}; in finish: {outcome.reason}" if ends else outcome.reason
        return way.then(outcome.way_out), text

    def _reach(self, way: WayOut) -> None:
        """Go to the final state of ``way``."""
        if way.state is RunState.FAULTED:
            self._apply(RunEvent.FAULT)
        elif way.state is RunState.ESTOPPED:
            self._apply(RunEvent.ESTOP)
        elif not way.finishes:
            self._apply(RunEvent.ABORT)
            self._apply(RunEvent.SAFE)
        else:
            finishing = self.state is RunState.FINISHING
            self._apply(RunEvent.FINISHED if finishing else RunEvent.STOP)

    def _judge(self, reason: str) -> tuple[WayOut, str]:
        """Return the ending of a run that reached its end, perhaps with missed cycles."""
        incomplete = WAYS_OUT[Severity.FAIL]
        counters = self.host.counters
        if counters.missed > MISSED_SHARE * (counters.cycles + counters.missed):
            share = 100 * counters.missed / (counters.cycles + counters.missed)
            return incomplete, f"{share:.0f} % of the cycles were missed (`rigd doctor`)"
        if self._incomplete:
            early = len(self._incomplete)
            return incomplete, f"{early} of {len(self.procedure.trials)} trials ended early"
        return WAYS_OUT[Severity.DONE], reason

    def _sequence(self) -> Outcome:
        """Play `prepare` and the trials, until an event ends the run."""
        outcome = self._play_block(self.procedure.prepare, "prepare")
        for trial in self.procedure.trials:
            if outcome.severity is not Severity.DONE:
                return outcome
            if trial.number not in self.done:
                outcome = self._between_trials() or self._judged(trial)
            elif self.host.virtual:
                outcome = self._between_trials() or self._play_again(trial)
        if outcome.severity is not Severity.DONE:
            return outcome
        return Outcome(Severity.DONE, "all trials played")

    def _judged(self, trial: TrialPlan) -> Outcome:
        """Play a trial and judge it if that is asked for; return DONE if another may follow."""
        outcome = self._play_trial(trial)
        if self.judge is None or outcome.severity is not Severity.DONE:
            return outcome
        refused = self.judge.judge(trial.number, self.host, self._asking, self.control)
        return refused or outcome

    def _report_progress(self) -> None:
        """Show progress between two cycles, and that a pause was requested."""
        self._follow_hold()
        if self.control.pause_wanted and self.state is RunState.RUNNING:
            self._apply(RunEvent.PAUSE)
        elif not self.control.pause_wanted and self.state is RunState.PAUSING:
            self._apply(RunEvent.RESUME)
        else:
            self.watch(self.progress)

    def _follow_hold(self) -> None:
        """Change to the state of a held step, or back."""
        if self.host.held:
            if self.state in (RunState.RUNNING, RunState.PAUSING):
                self._apply(RunEvent.HOLD)
        elif self.state is RunState.HELD:
            self._apply(RunEvent.RESUME)

    def _between_trials(self) -> Outcome | None:
        """Wait here during a pause; return why no trial follows, or None."""
        outcome = self._rest_in_pause()
        if outcome is not None:
            return outcome
        if self.control.last_trial:
            return Outcome(Severity.STOP, self.control.last_trial)
        barred = self.host.lockout_reason()
        return Outcome(Severity.FAULT, barred) if barred else None

    def _rest_in_pause(self) -> Outcome | None:
        """Keep the rig at rest while a pause is wanted; return an outcome if the cycle acts."""
        if not self.control.pauses:
            return None
        if self.state is RunState.RUNNING:
            self._apply(RunEvent.PAUSE)
        self._apply(RunEvent.TRIAL_ENDED)
        outcome = self.host.rest_while(self._still_paused)
        if outcome is None:
            self._apply(RunEvent.RESUME)
        return outcome

    def _still_paused(self) -> bool:
        if self.host.virtual:
            idle(0.05)
        return self.control.pauses

    def _play_again(self, trial: TrialPlan) -> Outcome:
        """Simulate a trial that is recorded, for the state in which it leaves rig and plant."""
        asking = self._asking
        self.host.drain()
        self.host.muted = True
        answers = GivenBefore(self.given.get(trial.number, ()))
        self._asking = Asking(self.host, answers, self.change, asking.set_up)
        try:
            return self._play_trial(trial)
        finally:
            self._asking = asking
            self.host.muted = False

    def _play_trial(self, trial: TrialPlan) -> Outcome:
        """Play a trial and its `after`; return DONE if the next trial may follow."""
        self._trial = trial
        seed = self.seeds.get(trial.number)
        if seed is not None:
            self.draw(seed)
        self.host.trial = trial.number
        parameters = dict(trial.parameters)
        self._event(
            "trial_start",
            {
                "number": trial.number,
                "repeat": trial.repeat,
                "parameters": parameters,
                "units": {k: u for k, u in self.procedure.units.items() if k in parameters},
            }
            | ({} if seed is None else {"seed": seed})
            | ({"answers": dict(self._asking.set_up)} if self._played_again else {}),
        )
        self._played_again = trial.number in self.done
        complete, reason, counts = False, "interrupted", False
        try:
            outcome = self._play(trial.steps, trial.after)
            complete = outcome.severity is Severity.DONE
            reason = outcome.reason or "all steps played"
            if outcome.severity is Severity.END_TRIAL and not outcome.latched:
                if trial.number not in self.done:
                    self._incomplete.append((trial.number, outcome.reason))
                if self.host.held:  # nothing moves before a person resumes
                    stopped = self._rest_in_pause()
                    if stopped is not None:
                        return stopped
                    if self.state is RunState.HELD:
                        self._apply(RunEvent.RESUME)
            elif not complete:
                return outcome
            outcome = self._play_block(trial.after, "after")
            if outcome.severity is not Severity.DONE:
                complete, reason = False, outcome.reason
                return outcome
            counts = trial.number not in self.done
            return outcome
        finally:
            self.host.drain()
            self._event("trial_end", {"complete": complete, "reason": reason})
            self._trial = None
            self._trials_done += counts
            self.host.trial = NO_TRIAL

    def _play_block(self, steps: Sequence[Step], block: str) -> Outcome:
        """Play a block of steps that must not end early."""
        outcome = self._play(steps)
        if outcome.severity is Severity.END_TRIAL:
            return Outcome(Severity.FAIL, f"{block}: {outcome.reason}", outcome.trip)
        return outcome

    def _play(self, steps: Sequence[Step], after: Sequence[Step] = ()) -> Outcome:
        """Play ``steps``; the first step of ``after`` follows the last without a gap."""
        for step, following in zip(steps, [*steps[1:], *after[:1], None], strict=False):
            if isinstance(step, Prompt):
                self._asked_s = self.host.run_s
                outcome = self._asking.ask(step)
                self._waited_s, self._asked_s = self._waited_s + self._waiting_s, None
                if outcome is not None:
                    return outcome
            elif isinstance(step, Fault):
                outcome = self._show(step)
                if outcome is not None:
                    return outcome
            else:
                then = following if isinstance(following, CycleProgram) else None
                outcome = self.host.play(step, then)
                self._follow_hold()
                if outcome.severity is not Severity.DONE:
                    return outcome
        return Outcome(Severity.DONE)

    def _show(self, fault: Fault) -> Outcome | None:
        """Show a fault of a simulated device; the setpoints do not change."""
        if self.faults is None:
            raise RuntimeError("a fault step was compiled for a rig that cannot show faults")
        try:
            self.faults.show(fault)
        except ValueError as error:
            return Outcome(Severity.FAIL, f"fault {fault.fault!r} of {fault.part}: {error}")
        self._event("fault_shown", asdict(fault))
        return None

    def _apply(self, event: RunEvent) -> None:
        """Go to the next state of the table; an event that the table refuses is a bug here."""
        state = next_state(self.state, event)
        if state is None:
            raise RuntimeError(f"run state {self.state.name} has no transition for {event.name}")
        if state is not self.state:
            self.state = state
            self.watch(self.progress)

    def _event(self, kind: str, data: Mapping[str, object]) -> None:
        self.host.event(kind, data)

    def _record_end(self, ending: str, reason: str) -> None:
        """Record how the run ended, if the sink still accepts events."""
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

    def _result(self, way: WayOut, reason: str, problems: Sequence[str]) -> RunResult:
        return RunResult(
            self.state,
            way.ending,
            reason,
            Exit.TRIPPED if problems else way.exit_code,
            self._trials_done,
            len(self.procedure.trials),
            self.progress.run_s,
            tuple(self._incomplete),
            self.host.counters.cycles,
            self.host.counters.missed,
            tuple(
                f"{trip.interlock.name} ({trip.interlock.action.word}): {trip.reason}"
                + (f" - {trip.message}" if trip.message else "")
                for trip in self.host.trips
            ),
            tuple(problems),
        )


def _not_at_rest(bound: RestBound, value: float, after_s: float) -> str:
    """Return a sentence on a channel that does not show that the rig rests."""
    since = f"{after_s:.1f} s after the end of the run"
    if isnan(value):
        return f"whether the rig rests is not known: {since} {bound.name} gives no value"
    shown, most = (format_quantity(x, bound.unit, 3) for x in (value, bound.bound))
    verb = "changes by" if bound.is_rate else "reaches"
    return f"the rig does not rest: {since} {bound.name} {verb} {shown}, `at_rest` allows {most}"
