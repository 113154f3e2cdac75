"""Reads from a recording at which trial an interrupted sweep continues."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rigd.engine.recorder import drain_into
from rigd.model.errors import ConfigError, RecordingError
from rigd.record import Recording, recover


@dataclass(frozen=True)
class ResumePoint:
    """The state of an interrupted run, from its recording.

    ``done`` are the numbers of complete trials; a trial that lost rows is not complete.
    ``overrides`` are its ``--set`` values. ``texts`` are its attached files by name.
    ``answered_by`` is the source of the last answer to a prompt, "" without prompts.
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


def read_resume_point(path: Path) -> ResumePoint:
    """Return the state of the run in ``path``; it is completed and repaired first.

    Raises:
        Blocked: that run is still in progress.
        RecordingError: no recording, or not a recording of ``rigd run``.
    """
    drain_into(path, command="rigd run --resume")
    recover(path)
    recording = Recording.open(path)
    run = recording.metadata.get("run", {})
    if not {"procedure", "rig", "seed"} <= run.keys():
        raise RecordingError(f"{path} does not name its run, so it cannot be resumed")
    events = recording.events()
    answers = [event.data for event in events if event.kind == "answer"]
    return ResumePoint(
        path=path,
        procedure=run["procedure"],
        rig=run["rig"],
        seed=int(run["seed"]),
        overrides=recording.metadata.get("overrides", {}),
        done=frozenset(trial.number for trial in recording.trials if trial.complete),
        texts={name: attachment.data for name, attachment in recording.attachments.items()},
        end_ns=recording.end_ns,
        answered_by=str(answers[-1]["by"]) if answers else "",
    )
