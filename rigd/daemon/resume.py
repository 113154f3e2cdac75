"""Reads from a recording at which trial an interrupted sweep continues."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.config.rig import RigConfig
from rigd.engine.run.answers import Given
from rigd.model.errors import ConfigError, RecordingError
from rigd.model.machine.system import on_linux
from rigd.record import Recording, recover
from rigd.record.read.info import SPECIMEN_METADATA

if TYPE_CHECKING:
    from rigd.engine.shared import RunFolder


@dataclass(frozen=True)
class ResumePoint:
    """The state of an interrupted run, from its recording.

    ``done`` are the numbers of complete trials; a trial that lost rows is not complete.
    ``overrides`` are its ``--set`` values. ``texts`` are its attached files by name.
    ``answered_by`` is the source of the last answer to a prompt, "" without prompts; ``given`` are
    all answers in the complete trials, by their number. ``pace`` is that of the run, None in
    virtual time and on devices.
    """

    path: Path
    procedure: str
    rig: str
    seed: int
    overrides: Mapping[str, str]
    done: frozenset[int]
    texts: Mapping[str, bytes]
    end_ns: int
    answered_by: str = ""
    specimen: str = ""
    given: Mapping[int, Sequence[Given]] = field(default_factory=dict)
    pace: float | None = None

    def check_same(self, name: str, text: str) -> None:
        """Raise unless the attached file ``name`` is ``text``.

        Raises:
            ConfigError: the sweep would go on with other files than it began with.
        """
        if self.texts.get(name) != text.encode():
            raise ConfigError(
                f"{self.path} was recorded with another {name}",
                hint="a sweep can be resumed only with the files it began with; "
                f"`rigd info {self.path} --attachments FOLDER` writes them out",
            )

    def check_specimen(self, name: str) -> None:
        """Raise if a specimen is stated that is not the one the run began with.

        Raises:
            ConfigError: the recording would mix two specimens.
        """
        if name and name != self.specimen:
            began = f"with specimen {self.specimen}" if self.specimen else "without a specimen"
            raise ConfigError(
                f"{self.path} was begun {began}, not with {name}",
                hint="remove --specimen to go on, or begin a new run",
            )


def read_resume_point(path: Path, held: RunFolder | None = None) -> ResumePoint:
    """Return the state of the run in ``path``; it is completed and repaired first.

    ``held`` is the folder of a rig that this process holds already.

    Raises:
        Blocked: that run is still in progress.
        RecordingError: no recording, or not a recording of ``rigd run``.
        NeedsLinux: it is damaged, and this is another system.
    """
    if on_linux():  # elsewhere no run leaves samples in memory
        from rigd.engine.recorder import drain_into

        drain_into(path, command="rigd run --resume", held=held)
    recover(path, others=False)
    recording = Recording.open(path)
    run = recording.metadata.get("run", {})
    if not {"procedure", "rig", "seed"} <= run.keys() or not run["seed"].isdecimal():
        raise RecordingError(f"{path} does not name its run, so it cannot be resumed")
    events = recording.events()
    answers = [event for event in events if event.kind == "answer"]
    complete = {trial.number: trial for trial in recording.trials if trial.complete}
    return ResumePoint(
        path=path,
        procedure=run["procedure"],
        rig=run["rig"],
        seed=int(run["seed"]),
        overrides=recording.metadata.get("overrides", {}),
        done=frozenset(complete),
        texts={name: attachment.data for name, attachment in recording.attachments.items()},
        end_ns=recording.end_ns,
        specimen=recording.metadata.get(SPECIMEN_METADATA, {}).get("name", ""),
        answered_by=str(answers[-1].data["by"]) if answers else "",
        given={
            number: [
                (str(event.data["name"]), event.data["answer"])
                for event in answers
                if event.trial == number and event.t_ns >= trial.start_ns
            ]
            for number, trial in complete.items()
        },
        pace=_pace_in(run.get("mode", "")),
    )


def simulated_at(pace: float | None) -> str:
    """Return the mode in the recording of a run that is simulated in process."""
    return "simulated, virtual time" if pace is None else f"simulated, paced {pace:g} x"


def _pace_in(mode: str) -> float | None:
    """Return the pace in what :func:`simulated_at` made; None if there is none."""
    found = re.fullmatch(r"simulated, paced (.+) x", mode)
    return None if found is None else float(found[1])


def left_out(rig: RigConfig, pace: float | None, done: frozenset[int]) -> frozenset[int]:
    """Return which of the trials ``done`` a resumed run does not play, not even unrecorded.

    In virtual time it simulates all of them again, so that prompts shown once per value are shown
    where they would be without an interruption.
    """
    return frozenset() if pace is None and rig.plant is not None else done
