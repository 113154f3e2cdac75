"""Executes a procedure on a rig and records it: the work of ``rigd run``."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING

from rigd.config.calibration.calibration import ATTACHMENT
from rigd.config.lab.lab import SPECIMEN_FILE, Specimen, stated_specimen
from rigd.config.rig import RigConfig
from rigd.config.shipped_files import titled
from rigd.daemon.calibration_check import calibration_metadata, exchanged, needed, unusable
from rigd.daemon.forms import RecordingSpec, RunSetup, in_process, processes
from rigd.daemon.provenance import run_metadata
from rigd.daemon.resume import ResumePoint, simulated_at
from rigd.daemon.signals import handle_signals
from rigd.daemon.trial_check import CheckApart, check_trial
from rigd.engine.clock import VirtualClock, WallClock
from rigd.engine.play.control import Control
from rigd.engine.run.answers import Answers, OwnAnswers
from rigd.engine.run.draws import trial_seeds
from rigd.engine.run.result import Progress, RunResult
from rigd.engine.run.run import Run
from rigd.engine.run.trial_judgement import TrialJudge
from rigd.model.about import About
from rigd.model.errors import Blocked, RecordingError
from rigd.model.machine.folders import make_folder
from rigd.model.machine.system import require_linux
from rigd.procedure.program import CompiledProcedure
from rigd.record import Attachment
from rigd.record.mcap.compression import Compression
from rigd.record.read.info import stated_metadata

if TYPE_CHECKING:  # of runs in real time alone
    from rigd.engine.shared import RunFolder

#: Virtual time begins here, one day later for each seed, so that files repeat bit for bit.
VIRTUAL_EPOCH_NS = int(datetime(2020, 1, 1, tzinfo=UTC).timestamp()) * 1_000_000_000
DAY_NS = 86_400_000_000_000
#: So many seeds have a day of their own, up to the year 2239; int64 nanoseconds end in 2262.
SEED_DAYS = 80_000
#: In virtual time, a resumed run begins this long after the last sample of the run before.
RESUME_GAP_NS = 1_000_000_000
#: So many states of progress wait for the display at most; others are skipped.
MAX_UNSEEN = 20
#: Below this much free disk a run does not start.
LEAST_FREE_BYTES = 50_000_000


@dataclass(frozen=True)
class RunRequest:
    """The procedure, the rig and the options of a run.

    ``pace`` is None for virtual time, 1 for real time. ``output`` None makes a name in ``folder``.
    ``overrides`` are the ``--set`` values as given, and ``about`` is the person's description of
    the run, for the record; ``specimen`` None: :func:`perform` reads its file, and checks both
    against the demands of the lab. ``procedure_location`` is where the procedure was found.
    """

    procedure: CompiledProcedure
    procedure_text: str
    rig: RigConfig
    seed: int
    pace: float | None = None
    folder: Path = Path("runs")
    output: Path | None = None
    resume: ResumePoint | None = None
    start_ns: int | None = None
    compression: Compression = "zstd"
    overrides: Mapping[str, str] = field(default_factory=dict)
    about: About = field(default_factory=About)
    specimen: Specimen | None = None
    procedure_location: str = ""

    @property
    def virtual(self) -> bool:
        """Whether the run plays in virtual time."""
        return self.pace is None and self.rig.plant is not None

    @property
    def apart(self) -> bool:
        """Whether the run plays in real time, in processes of its own."""
        return self.rig.plant is None or self.pace == 1

    @property
    def title(self) -> str:
        """The procedure and the rig, with the locations of their files."""
        rig = titled(self.rig.name, self.rig.source.location)
        return f"{titled(self.procedure.name, self.procedure_location)} on {rig}"


@dataclass(frozen=True)
class RecordedRun:
    """A run that ended, and its file."""

    path: Path
    result: RunResult


def execute(
    request: RunRequest,
    *,
    answers: Answers | None = None,
    watch: Callable[[Progress], None] = lambda _: None,
    notify: Callable[[str], None] = lambda _: None,
    control: Control | None = None,
    announce: Callable[[Path], None] = lambda _: None,
) -> RecordedRun:
    """Execute the procedure for a person at a terminal; see :func:`perform`.

    Signals are handled while it runs (:func:`rigd.daemon.signals.handle_signals`). ``notify`` gets
    lines for the operator; like ``watch`` and ``announce`` it may wait for the terminal, or fail.
    """
    control = control or Control()
    display = _Display(watch, notify, announce, control)
    try:
        with handle_signals(control):
            return perform(
                request, control, answers=answers, watch=display.watch, announce=display.announce
            )
    finally:
        display.close()


def perform(
    request: RunRequest,
    control: Control,
    *,
    answers: Answers | None = None,
    watch: Callable[[Progress], None] = lambda _: None,
    announce: Callable[[Path], None] = lambda _: None,
    held: RunFolder | None = None,
) -> RecordedRun:
    """Run the procedure and return how it ended, with the path of its recording.

    ``watch`` is called several times a second and must not wait. ``announce`` gets the path as soon
    as the file exists. ``held`` is the rig's folder if the caller has taken it.

    Raises:
        Blocked: preflight refused; nothing moved.
        RecordingError: the recording cannot be written; the rig is safe.
        ConfigError: the recording to resume was made with another procedure or rig file, or what is
            stated is not what the lab demands; nothing moved.
        NeedsLinux: it plays in real time, and this is another system.
    """
    if request.apart:
        require_linux("a run in real time")
    request = replace(request, rig=request.procedure.on(request.rig))
    if request.specimen is None and request.resume is None:
        request = replace(request, specimen=stated_specimen(request.about, request.rig.lab))
    rests_on = needed(request.procedure, request.rig)
    resume = request.resume
    done = frozenset[int]() if resume is None else resume.done
    if resume is not None:
        check_resumable(request, resume)
        path = resume.path
    else:
        path = request.output or new_path(request)
        make_folder(path.parent, "--output" if request.output else "--runs")
    form = _form(request, control, path, len(done), held)
    procedure = request.procedure
    seeds = trial_seeds(request.seed, request.rig.name, procedure.name, procedure.trials)
    if done and request.virtual:
        control.notices.append(
            f"{len(done)} recorded trials are simulated again first, unrecorded: the others are "
            "then as in a run without an interruption"
        )
    try:
        announce(path)
        run = Run(
            request.procedure,
            form.host,
            control,
            answers or OwnAnswers(),
            change=form.change,
            faults=form.faults,
            draw=form.draw or (lambda _: None),
            seeds={} if form.draw is None else seeds,
            done=done,
            given={} if resume is None else resume.given,
            watch=watch,
            judge=_judge(request, path),
            supervision=request.rig.supervision,
            extra_checks=(
                lambda: _disk_check(path.parent),
                lambda: unusable(request.rig, rests_on, day_of(request.start_ns)),
            ),
            identity_check=lambda identities: list(exchanged(request.rig, rests_on, identities)),
        )
        return RecordedRun(path, run.execute())
    except Blocked:
        if resume is None:
            path.unlink(missing_ok=True)  # nothing moved: the file holds a few rows at rest
        raise
    finally:
        form.release()


def _judge(request: RunRequest, path: Path) -> TrialJudge | None:
    """Return what evaluates each trial of the recording at ``path``; None if nothing does."""
    plan = request.procedure.identify
    if plan is None or plan.check is None:
        return None
    if request.virtual:
        return TrialJudge(partial(check_trial, path), plan.check)
    apart = CheckApart(path)
    return TrialJudge(apart.check, plan.check, apart.give_up)


def check_resumable(request: RunRequest, resume: ResumePoint) -> None:
    """Check that the run continues with the files with which it began.

    Raises:
        ConfigError: one of them is another file, or another specimen is stated.
    """
    resume.check_specimen(request.about.specimen)
    for name, text in attached_texts(request).items():
        resume.check_same(name, text)


def _form(
    request: RunRequest, control: Control, path: Path, done: int, held: RunFolder | None
) -> RunSetup:
    """Return the host that the request asks for, recording to ``path``."""
    rig = request.rig
    start_ns = _start_ns(request, on_the_wall=request.pace is not None or request.apart)
    metadata = _metadata(request, start_ns)
    if request.resume is not None:
        resumed = {"mode": metadata["run"]["mode"], "trials": str(done)}
        stated = stated_metadata(request.about, request.specimen, resumed)
        metadata = {"resumed": resumed} | stated
    kept = RecordingSpec(
        path,
        request.procedure.record,
        metadata,
        tuple(
            Attachment(name, _media_type(name), text.encode())
            for name, text in attached_texts(request).items()
        ),
        request.compression,
        request.resume is not None,
    )
    if request.apart:
        command = f"rigd run {request.procedure.name}"
        return processes(
            rig,
            control,
            request.seed,
            start_ns=start_ns,
            kept=kept,
            command=command,
            held=held,
        )
    if request.pace is None:
        clock = VirtualClock(rig.period_ns, start_ns)
        return in_process(rig, clock, control, request.seed, virtual=True, kept=kept)
    return _paced(rig, request.pace, control, request.seed, start_ns, kept)


def _paced(
    rig: RigConfig, pace: float, control: Control, seed: int, start_ns: int, kept: RecordingSpec
) -> RunSetup:
    """Return a host at ``pace``, which states once if this machine computes slower."""
    clock = WallClock(rig.period_ns, pace, start_ns)
    form = in_process(rig, clock, control, seed, virtual=False, kept=kept)

    def tell(reached: float) -> None:
        control.notices.append(
            f"slower than asked: {reached:.2g} of {pace:g} times real time is what this machine "
            "computes now"
        )
        form.host.event("slower", {"pace": pace, "reached": reached})

    clock.on_slower = tell
    return form


class _Display:
    """Shows the run to a person from a thread of its own.

    A terminal may be stopped (Ctrl-S), closed or full: the cycle never waits for it, and no run
    ends for it.
    """

    def __init__(
        self,
        show: Callable[[Progress], None],
        notify: Callable[[str], None],
        announce: Callable[[Path], None],
        control: Control,
    ) -> None:
        self._show = show
        self._notify = notify
        self._announce = announce
        self._control = control
        self._shown: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()

    def announce(self, path: Path) -> None:
        """Pass the path of the recording."""
        self._shown.put(partial(self._announce, path))

    def watch(self, progress: Progress) -> None:
        """Pass notices, then the progress of the run; if no client watches, skip."""
        while self._control.notices:
            self._shown.put(partial(self._notify, self._control.notices.popleft()))
        if self._shown.qsize() < MAX_UNSEEN:
            self._shown.put(partial(self._show, progress))

    def close(self) -> None:
        """Show the queued lines, as far as the terminal accepts them."""
        self._shown.put(None)
        self._thread.join(timeout=1.0)

    def _work(self) -> None:
        with suppress(OSError):  # the terminal is gone
            while (show := self._shown.get()) is not None:
                show()


def _start_ns(request: RunRequest, *, on_the_wall: bool) -> int:
    """Return the Unix time at which the run begins, in ns."""
    if on_the_wall:
        start_ns = time.time_ns()
    elif request.start_ns is not None:
        start_ns = request.start_ns
    else:
        start_ns = VIRTUAL_EPOCH_NS + request.seed % SEED_DAYS * DAY_NS
    if request.resume is not None:
        # Later than everything in the file: time never goes back within a recording.
        start_ns = max(start_ns, request.resume.end_ns + RESUME_GAP_NS)
    return start_ns


def _metadata(request: RunRequest, start_ns: int) -> dict[str, dict[str, str]]:
    mode = simulated_at(request.pace)
    if request.rig.plant is None:
        mode = "hardware" if request.rig.simulation is None else "simulated at the wire"
    records = run_metadata(
        request.procedure,
        request.rig,
        seed=request.seed,
        start_ns=start_ns,
        mode=mode,
        overrides=request.overrides,
    )
    files = {"procedure_file": request.procedure_location, "rig_file": request.rig.source.location}
    records["run"] |= {name: location for name, location in files.items() if location}
    stated = stated_metadata(request.about, request.specimen, records["run"])
    return records | stated | calibration_metadata(request.rig)


def day_of(start_ns: int | None) -> date:
    """Return the day of a run for the operator's calendar, which virtual time does not follow.

    ``start_ns`` is when it was asked to begin, None for now.
    """
    if start_ns is not None:
        return datetime.fromtimestamp(start_ns * 1e-9, UTC).date()
    return datetime.now(UTC).date()


def attached_texts(request: RunRequest) -> dict[str, str]:
    """Return the files the run is made from, by the name they are attached under.

    Files of plant and devices keep their place beside the rig file, so that all of them written out
    again make the same rig.
    """
    texts = {
        "procedure.yaml": request.procedure_text,
        "rig.yaml": request.rig.source.text,
    }
    calibration = request.rig.calibration
    if calibration is not None and calibration.held is not None:
        texts[ATTACHMENT] = calibration.held.text
    if request.specimen is not None and request.specimen.text:
        texts[SPECIMEN_FILE] = request.specimen.text
    plant = request.rig.plant
    if plant is not None:
        texts.update(plant.config.attachments())
    files = {} if plant is None else dict(plant.config.files())
    for device in request.rig.devices.values():
        files.update(device.config.files())
    folder = request.rig.source.path.resolve().parent
    for path, text in files.items():
        whole = path.resolve()
        beside = whole.is_relative_to(folder)
        texts[whole.relative_to(folder).as_posix() if beside else path.name] = text
    return texts


def _media_type(name: str) -> str:
    """Return the media type of an attached file: a maker's EDS is no YAML."""
    return "application/yaml" if name.endswith((".yaml", ".yml")) else "text/plain"


def new_path(request: RunRequest) -> Path:
    """Return a path in the folder that no file has yet: time, procedure, floor or the like.

    Raises:
        RecordingError: the folder cannot be made.
    """
    make_folder(request.folder, "--runs")
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    words = [stamp, request.procedure.name]
    plan = request.procedure.identify
    if plan is not None:
        words += [
            str(request.procedure.parameters[name])
            for name in plan.group_by
            if isinstance(request.procedure.parameters.get(name), str)
        ]
    stem = "-".join(words)
    for count in range(1, 1000):
        suffix = "" if count == 1 else f"-{count}"
        path = request.folder / f"{stem}{suffix}.mcap"
        if not path.exists():
            return path
    raise RecordingError(f"{request.folder} has a thousand recordings called {stem}")


def _disk_check(folder: Path) -> Sequence[str]:
    free = shutil.disk_usage(folder).free
    if free >= LEAST_FREE_BYTES:
        return ()
    return (
        f"{folder} has {free / 1e6:.0f} MB free, a recording needs at least "
        f"{LEAST_FREE_BYTES / 1e6:.0f} MB: delete or move old recordings",
    )
