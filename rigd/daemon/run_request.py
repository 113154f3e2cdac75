"""Makes the request of a run from the names of its files, and plays it for a program."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from rigd.analysis.plan import judged
from rigd.config.lab.lab import stated_specimen
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute, perform
from rigd.daemon.resume import ResumePoint, left_out
from rigd.engine.play.control import Control
from rigd.model.about import About
from rigd.model.errors import ConfigError, Exit
from rigd.model.machine.extras import require
from rigd.procedure.chosen_rig import chosen_rig
from rigd.procedure.loader import load_procedure
from rigd.record import Recording
from rigd.record.mcap.compression import Compression

#: The seed of a run that is given none.
SEED = 1


def requested(
    procedure: str | Path,
    rig: str | Path,
    *,
    overrides: Mapping[str, str],
    about: About,
    seed: int | None = None,
    pace: float | None = None,
    start_ns: int | None = None,
    output: Path | None = None,
    folder: Path = Path("runs"),
    resume: ResumePoint | None = None,
    compression: Compression = "zstd",
) -> RunRequest:
    """Return the request to run a procedure on a rig, by their files or names; nothing moves.

    The others are as for :class:`RunRequest`; ``seed`` None is that of ``resume``, or 1;
    ``pace`` None is that of ``resume``, or virtual time, which 0 is in any case.

    Raises:
        ConfigError: a file is missing or wrong, the procedure does not fit the rig or its analysis,
            ``pace`` or ``start_ns`` is given for real devices, or
            ``resume`` began with other files.
    """
    texts: Mapping[str, bytes] = {} if resume is None else resume.texts
    loaded = load_rig(rig, texts.get("rig.yaml"))
    if loaded.plant is None and (pace not in (None, 1.0) or start_ns is not None):
        raise ConfigError(
            f"rig {loaded.name} is not simulated in process: its devices run in real time",
            hint="remove --pace and --start",
        )
    if pace is None and resume is not None:
        pace = resume.pace
    pace = pace or None
    source = load_procedure(procedure, texts.get("procedure.yaml"))
    done = frozenset[int]() if resume is None else resume.done
    unplayed = left_out(loaded, pace, done)
    compiled = judged(source, loaded, overrides, done=unplayed)
    if resume is not None:
        resume.check_same("procedure.yaml", source.file.text)
        resume.check_same("rig.yaml", loaded.source.text)
        resume.check_specimen(about.specimen)
    if seed is None:
        seed = SEED if resume is None else resume.seed
    return RunRequest(
        compiled,
        source.file.text,
        loaded,
        seed,
        pace=pace,
        folder=folder,
        output=output,
        resume=resume,
        start_ns=start_ns,
        compression=compression,
        overrides=overrides,
        about=about,
        specimen=None if resume is not None else stated_specimen(about, loaded.lab),
        procedure_location=source.location,
    )


def run(
    procedure: str | os.PathLike[str],
    *,
    rig: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    set: Mapping[str, object] | None = None,
    seed: int = SEED,
    start: datetime | None = None,
    operator: str = "",
    note: str = "",
    meta: Mapping[str, object] | None = None,
    specimen: str = "",
    notify: Callable[[str], None] = lambda _: None,
) -> Recording:
    """Run a procedure on a simulated rig in virtual time, as ``rigd run`` does.

    The recording is returned however the run ended: ``recording.state`` and ``recording.reason``
    state how. Prompts get the procedure's own answers.

    Args:
        procedure: procedure file, or the name of a shipped procedure.
        rig: rig file, or the name of a rig, that is simulated in process; None: as of a command
            without ``--rig``, and ``notify`` gets the line that says which it is.
        out: recording to write; None: a name in ``runs/``.
        set: values of the procedure's parameters by name, with their units.
        seed: seed of the simulation.
        start: time of the first sample; UTC if it has no time zone.
        operator: who runs it, for the recording.
        note: a note, for the recording.
        meta: names and values for the recording, such as ``{"batch": 13}``.
        specimen: name of the specimen, for the recording.
        notify: gets lines for the operator.

    Raises:
        ConfigError: a file or a value is wrong, or the rig is not simulated in process.
        Blocked: preflight refused the run.
        RecordingError: the recording cannot be written, or exists already.
        MissingExtra: the procedure measures, and the libraries of analyses are not installed.
        KeyboardInterrupt: Ctrl-C stopped the run; what was recorded is whole.
    """
    texts = {name: str(value) for name, value in (meta or {}).items()}
    try:
        about = About(operator.strip(), note.strip(), texts, specimen.strip())
    except ValueError as error:
        raise ConfigError(
            str(error), hint="operator, note, specimen and meta are recorded as text"
        ) from error
    chosen = chosen_rig(None if rig is None else os.fspath(rig), os.fspath(procedure))
    if chosen.why:
        notify(chosen.why)
    request = requested(
        os.fspath(procedure),
        chosen.rig,
        overrides={name: str(value) for name, value in (set or {}).items()},
        about=about,
        seed=seed,
        start_ns=None if start is None else _ns(start),
        output=None if out is None else Path(out),
    )
    if not request.virtual:
        raise ConfigError(
            f"rig {request.rig.name} is not simulated in process: rigd.run plays in virtual time",
            hint="`rigd run` runs a rig in real time",
        )
    if request.procedure.measures:
        require("analysis", "a procedure that measures")
    if threading.current_thread() is threading.main_thread():
        recorded = execute(request, notify=notify)
    else:  # only the main thread gets signals
        recorded = perform(request, Control())
    if recorded.result.exit_code is Exit.STOPPED:
        raise KeyboardInterrupt(recorded.result.reason)
    return Recording.open(recorded.path)


def _ns(start: datetime) -> int:
    moment = start if start.tzinfo is not None else start.replace(tzinfo=UTC)
    return int(moment.timestamp()) * 1_000_000_000
