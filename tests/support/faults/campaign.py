"""Faults shown to a run that moves the rig at the wire, and what became of rig and run."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from support.faults.killing import END_S, SHAKING, Movement, Victim, gaps, own_state
from support.faults.table import SECOND, Case, Must
from support.wire import ROOT, WireRig

from rigd.engine.shared import Word
from rigd.model.channels import STALE, STATUS_FIELD
from rigd.model.errors import Exit
from rigd.record import Recording

#: Cases that share a run while it goes on.
SHARED = 12
#: After a fault is cleared, what it leaves behind shows within this time.
SETTLE_S = 0.5
#: A crowded host makes some rows late; a fault marks at least this share more of them, and twice
#: as many as before.
USUAL_SHARE = 0.05
MARKED = "marked rows"
#: What names the cause of an end: kinds of events, and what the tables call them.
EVENTS = {"fault": "device fault", "interlock": "interlock"}
#: How often a run is started until it moves.
STARTS = 4


@dataclass(frozen=True)
class Outcome:
    """What one fault led to; times in s from the injection."""

    detected_by: str  #: device fault, interlock, marked rows, refused, nothing
    detected_s: float | None
    safe_s: float | None  #: until every drive was without torque, if the run ended
    moved: bool  #: refused: whether anything was driven all the same
    whole: bool  #: every cycle that ran is in the recording, and its end
    exit_code: int | None  #: None: the run went on
    told: str  #: the sentence the operator was told


@dataclass(frozen=True)
class _Shown:
    """A case under way or done; CLOCK_MONOTONIC in ns."""

    case: Case
    began_ns: int
    ended_ns: int


class Campaign:
    """Plays cases on a rig; those that let a run go on share it.

    ``report`` gets every case with what became of it, once the recording has been read.
    """

    def __init__(
        self,
        rig: WireRig,
        folder: Path,
        report: Callable[[Case, Outcome], None],
        movement: Movement = SHAKING,
        set_up: Callable[[WireRig], None] = lambda rig: None,
        by_hand: Callable[[WireRig], None] = lambda rig: None,
    ) -> None:
        self._by_hand = by_hand
        self._rig = rig
        self._set_up = set_up
        self._movement = movement
        self._folder = folder
        self._report = report
        self._run: Victim | None = None
        self._place = self._state = folder
        self._offset_ns = 0
        self._shown: list[_Shown] = []
        self._told = ""
        self._code: int | None = None

    def play(self, *cases: Case) -> None:
        """Play one case, or several of different parts at once.

        Of these none may end the run, or all are shown before it starts.
        """
        if cases[0].before:
            self.finish()
            outcome = self._second() if cases[0].fault == SECOND else self._start_in_vain(cases)
            for case in cases:
                self._report(case, outcome)
            return
        if len(self._shown) >= SHARED:
            self.finish()
        if self._run is None:
            self._begin()
        began_ns = [self._inject(case) for case in cases]
        ended = self._ends_within(max(max(case.watch_s, case.within_s) for case in cases))
        ended_ns = time.monotonic_ns()
        self._shown += [
            _Shown(case, since_ns, ended_ns) for case, since_ns in zip(cases, began_ns, strict=True)
        ]
        if not ended and cases[0].must is Must.NAME:
            self._examine(stop=True)
            return
        if not ended:
            self._rig.ask(do="clear")
            ended = self._ends_within(SETTLE_S)
        if ended:
            self._examine()

    def finish(self) -> None:
        """Stop the run under way, if any, and report what it has shown."""
        if self._run is not None:
            self._examine(stop=True)

    def _inject(self, case: Case) -> int:
        """Show the fault; return when the simulation began to, CLOCK_MONOTONIC in ns."""
        options = dict(case.options)
        done = self._rig.ask(do="fault", part=case.part, fault=case.fault, options=options)
        return int(done["t_ns"])

    def _ends_within(self, time_s: float) -> bool:
        """Return whether the run has ended within this time, or is about to: a drive is off."""
        assert self._run is not None
        process, deadline = self._run.process, time.monotonic() + time_s
        while time.monotonic() < deadline:
            if process.poll() is not None:
                return True
            time.sleep(0.01)
        return any(self._rig.parts()[name]["safe_since_ns"] for name in self._movement.drives)

    def _begin(self) -> None:
        for left in reversed(range(STARTS)):
            self._place = Path(tempfile.mkdtemp(dir=self._folder))
            self._state = own_state(self._place)
            self._shown = []
            self._set_up(self._rig)
            try:
                self._run = Victim(self._rig, self._place, self._state, self._movement)
                break
            except AssertionError:  # the host has stalled as the rig was armed
                self._clean()
                if not left:
                    raise
        assert self._run is not None
        board = self._run.folder.board()
        self._offset_ns = board[Word.START_NS] - board[Word.ORIGIN_NS]

    def _examine(self, *, stop: bool = False) -> None:
        """Wait for the end of the run, which is asked to end if ``stop``, and report its cases."""
        run, self._run = self._run, None
        assert run is not None
        try:
            if stop:
                run.process.send_signal(signal.SIGINT)
            run.process.wait(END_S)
            self._rig.ask(do="clear")  # a drive that is stuck is safe only now
            if self._shown and self._shown[-1].case.must is Must.NAME:
                self._by_hand(self._rig)
            safe_ns = run.wait_until_safe()
            self._told, self._code = run.told(), run.process.returncode
            recording = Recording.open(run.recording)
            whole = _whole(recording, self._movement.stream)
            last = self._shown[-1] if self._shown else None
            for item in self._shown:
                ended_by_it = item is last and self._code != Exit.STOPPED
                outcome = self._outcome(recording, item, ended_by_it, safe_ns, whole)
                self._report(item.case, outcome)
        finally:
            run.end()
            self._clean()

    def _clean(self) -> None:
        self._rig.ask(do="clear")
        shutil.rmtree(self._state)
        shutil.rmtree(self._place)

    def _outcome(
        self, recording: Recording, _shown: _Shown, ended_by_it: bool, safe_ns: int, whole: bool
    ) -> Outcome:
        told = ""
        if ended_by_it:
            told = " ".join(self._told.split())
            _shown = replace(_shown, ended_ns=time.monotonic_ns())  # its drives may be off first
        earlier = [item for item in self._shown if item.began_ns < _shown.began_ns]
        detected, at_ns = _detected(recording, _shown, self._offset_ns, earlier)
        after_s = None if at_ns is None else (at_ns - self._offset_ns - _shown.began_ns) * 1e-9
        safe_s = (safe_ns - _shown.began_ns) * 1e-9 if ended_by_it else None
        if _shown.case.must is Must.NAME:
            detected, after_s, safe_s = "named at the end", None, None
        code = self._code if ended_by_it else None
        return Outcome(detected, after_s, safe_s, False, whole, code, told)

    def _start_in_vain(self, cases: Sequence[Case]) -> Outcome:
        """Show the faults, then start a run, which must be refused before anything moves."""
        self._place = Path(tempfile.mkdtemp(dir=self._folder))
        self._state = own_state(self._place)
        rig = self._rig.rig
        for case in cases:
            if case.injected:
                self._inject(case)
            if case.edit is not None:
                right, wrong = case.edit
                text = rig.read_text()
                assert right in text
                rig = self._place / "wrong.yaml"
                rig.write_text(text.replace(right, wrong))
        try:
            with started(rig, self._place, self._state, self._movement) as process:
                return self._refused(process, lambda: self._movement.moves(self._rig.parts()))
        finally:
            self._clean()

    def _second(self) -> Outcome:
        """Start a run beside one that moves the rig: it is refused, and the first goes on."""
        self._begin()
        try:
            elsewhere = Path(tempfile.mkdtemp(dir=self._folder))
            state = own_state(elsewhere)  # as on another computer: no lock keeps them apart
            with started(self._rig.rig, elsewhere, state) as process:
                outcome = self._refused(process, lambda: False)
            shutil.rmtree(state)
            gone_on = not self._ends_within(SETTLE_S)
            return replace(outcome, whole=outcome.whole and gone_on)
        finally:
            self.finish()

    def _refused(self, process: subprocess.Popen[str], moves: Callable[[], bool]) -> Outcome:
        """Wait for the end of a run that must be refused."""
        began_ns, moved = time.monotonic_ns(), False
        while process.poll() is None:
            moved = moved or moves()
            if moved or time.monotonic_ns() - began_ns > END_S * 1e9:
                process.send_signal(signal.SIGINT)
                break
            time.sleep(0.05)
        out, _ = process.communicate(timeout=END_S)
        after_s = (time.monotonic_ns() - began_ns) * 1e-9
        refused = process.returncode in (Exit.BLOCKED, Exit.TRIPPED)
        return Outcome(
            "refused" if refused else "nothing", after_s if refused else None, None, moved,
            True, process.returncode, " ".join(out.split()),
        )  # fmt: skip


@contextmanager
def started(
    rig: Path, place: Path, state: Path, movement: Movement = SHAKING
) -> Iterator[subprocess.Popen[str]]:
    """A run of ``movement`` on ``rig``, which may well be refused."""
    procedure = place / "movement.yaml"
    procedure.write_text(movement.procedure)
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "rigd", "run", str(procedure), "--yes"),
            *("--rig", str(rig), "--output", str(place / "run.mcap")),
        ],
        cwd=ROOT,
        env={**os.environ, "RIGD_STATE": str(state)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def verdict(case: Case, outcome: Outcome) -> list[str]:
    """Return what is wrong with ``outcome``, a sentence each; empty if all is as it must be."""
    wrong = []
    if not outcome.whole:
        wrong.append("the recording is not whole")
    wrong += [f"the operator is shown: {word}" for word in ("Traceback", "internal error")
              if word in outcome.told]  # fmt: skip
    cause = cause_in(outcome.told, case.must)
    wrong += [f"the operator is not told {word!r}" for word in case.words
              if not re.search(word, cause)]  # fmt: skip
    match case.must:
        case Must.BLOCK:
            if outcome.exit_code != case.code:
                wrong.append(f"not refused, but exit code {outcome.exit_code}")
            if outcome.moved:
                wrong.append("a drive was driven")
        case Must.END:
            wrong += _wrong_end(case, outcome)
        case Must.NAME:
            if outcome.exit_code != Exit.TRIPPED:
                wrong.append(f"no exit code {int(Exit.TRIPPED)}, but {outcome.exit_code}")
        case Must.MARK | Must.GO_ON:
            if outcome.exit_code is not None:
                wrong.append(f"the run ended with exit code {outcome.exit_code}")
            if case.must is Must.MARK and outcome.detected_by != MARKED:
                wrong.append(f"no row is marked; detected: {outcome.detected_by}")
    return wrong


def _wrong_end(case: Case, outcome: Outcome) -> Iterator[str]:
    if outcome.exit_code != Exit.TRIPPED:
        yield f"the run was to end, exit code {int(Exit.TRIPPED)}; found {outcome.exit_code}"
    elif outcome.detected_by not in EVENTS.values():
        yield f"the recording names no cause of the end, but: {outcome.detected_by}"
    elif outcome.detected_s is None or outcome.detected_s > case.within_s:
        yield f"detected after {outcome.detected_s} s, expected {case.within_s} s"
    elif outcome.safe_s is None or outcome.safe_s > outcome.detected_s + case.safe_s:
        yield f"safe after {outcome.safe_s} s, detected after {outcome.detected_s:.3f} s"


def cause_in(told: str, must: Must) -> str:
    """Return what a command told of the cause: without what it began with, and what to do next.

    The names of procedure, rig and files would match words that are sought. Of a run that a fault
    ended, also without how it ended and which devices could not be made safe.
    """
    text = " ".join(told.split())
    text = (text.partition("run.mcap ")[2] or text).partition(" continue with:")[0]
    if must is Must.END:
        text = _ENDED.sub("", text)
        text = _UNSAFE.split(text)[0]
    return text


#: What stands before the cause of an end, and before a device that could not be made safe.
_ENDED = re.compile(r"^(trial \d+/\d+: )?(trial \d+ )?(faulted|aborted): ")
_UNSAFE = re.compile(r" \w+ (?:could not be made|does not confirm that it is|is not) safe")


def _whole(recording: Recording, stream: str) -> bool:
    """Return whether every cycle that ran is in the file, and the run's end."""
    ended = any(event.kind == "run_end" for event in recording.events())
    return ended and not gaps(recording, stream)


def _detected(
    recording: Recording, _shown: _Shown, offset_ns: int, earlier: Sequence[_Shown]
) -> tuple[str, int | None]:
    """Return by what the fault was detected and when first, on the clock of the run.

    A cycle stamps what it finds with the time at which it was due: the earliest that can find the
    fault is the cycle that had begun last when the fault was shown.
    """
    began, ended = _shown.began_ns + offset_ns, _shown.ended_ns + offset_ns
    cycles = recording.read("cycle")
    due_ns = cycles["t_ns"].astype(np.int64)
    late_s = cycles["actual"] - cycles["scheduled"]
    begun_ns = due_ns + np.rint(1e9 * late_s).astype(np.int64)
    earliest = int(due_ns[begun_ns <= began].max(initial=0))
    for event in recording.events():
        if event.kind in EVENTS and earliest <= event.t_ns <= ended:
            return EVENTS[event.kind], max(event.t_ns, began)
    part = _shown.case.part  # a bus has no rows of its own: those of all devices show it
    streams = [part] if part in recording.streams else sorted({*recording.streams} - {"cycle"})
    spoilt = [
        (item.began_ns + offset_ns, item.ended_ns + offset_ns + round(SETTLE_S * 1e9))
        for item in earlier
    ]
    marks = [_first_mark(recording, name, began, ended, spoilt) for name in streams]
    first = min((mark for mark in marks if mark is not None), default=None)
    return ("nothing", None) if first is None else (MARKED, first)


def _first_mark(
    recording: Recording, stream: str, began: int, ended: int, spoilt: Sequence[tuple[int, int]]
) -> int | None:
    """Return when the rows of ``stream`` began to be marked much more often than before.

    Those between the times ``spoilt`` do not count: other faults were shown then.
    """
    rows = recording.read(stream)
    t_ns = rows["t_ns"].astype(np.int64)
    inside, before = (t_ns >= began) & (t_ns <= ended), t_ns < began
    for since, until in spoilt:
        before &= (t_ns < since) | (t_ns > until)
    marked = _marks(rows, t_ns, before)
    if not inside.any():
        return began
    usual = float(marked[before].mean()) if before.any() else 0.0
    between = np.diff(t_ns)
    longest = int(between[inside[1:]].max(initial=0))
    sound = between[before[1:] & before[:-1]]
    silent = sound.size > 0 and longest > 3 * max(int(sound.max()), 20_000_000)
    if not silent and float(marked[inside].mean()) < 2 * usual + USUAL_SHARE:
        return None
    return int(t_ns[inside & marked].min(initial=ended))


def _marks(
    rows: NDArray[np.void], t_ns: NDArray[np.int64], before: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which rows report of themselves that they are not valid."""
    marked = np.zeros(len(t_ns), bool)
    for name in rows.dtype.names or ():
        values = rows[name]
        if name == STATUS_FIELD:
            status = values.astype(np.uint32)
            marked |= (status & np.uint32(STALE)) != 0
            flags = status & ~np.uint32(STALE)
            seen, counts = np.unique(flags[before], return_counts=True)
            marked |= ~np.isin(flags, seen[counts > USUAL_SHARE * counts.sum()])
        elif name != "t_ns":
            marked |= np.isnan(values)
    return marked
