"""Prepares a run in one process, or in three processes that supervise each other.

If the rig is simulated in process, the run plays in this process: in virtual time, or at a pace (a
multiple of real time). At pace 1, and if the devices are behind links, the cycle and the recorder
are processes of their own. The code of the run does not know the form: it uses only a host.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigd.config.rig import RigConfig
from rigd.engine.clock import Clock
from rigd.engine.cycle.wiring import streams_of, wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.run.asking import ChangePlant
from rigd.engine.run.faults import Ask, ShownFaults
from rigd.engine.run.host import Host
from rigd.model.errors import LinkError
from rigd.procedure.program import Recorded
from rigd.record import Attachment, RecordingWriter
from rigd.record.mcap.compression import Compression

if TYPE_CHECKING:  # of runs in real time alone, on Linux
    from rigd.engine.recorder import RecorderProcess
    from rigd.engine.shared import RunFolder

#: The rings hold the rows of this time while the recorder is being restarted, in s.
RING_S = 60.0


@dataclass(frozen=True)
class RecordingSpec:
    """The streams that a run records, and its file: new or, with ``resume``, existing."""

    path: Path
    record: Mapping[str, Recorded]
    metadata: Mapping[str, Mapping[str, str]]
    attachments: tuple[Attachment, ...]
    compression: Compression
    resume: bool


@dataclass(frozen=True)
class RunSetup:
    """A host ready for a run and, if the rig is simulated, the function that changes its plant."""

    host: Host
    change: ChangePlant | None
    #: Lets the plant of a rig that is simulated in process draw from the seed of a trial.
    draw: Callable[[int], None] | None = None
    #: Makes devices that are simulated at the wire show faults; None for other devices.
    faults: ShownFaults | None = None
    #: Ends everything that was started for the run, however it ended.
    release: Callable[[], None] = lambda: None


def in_process(
    rig: RigConfig, clock: Clock, control: Control, seed: int, *, virtual: bool, kept: RecordingSpec
) -> RunSetup:
    """Return a host in this process, and its recording begun.

    Raises:
        Blocked: a device of the rig needs real time.
        RecordingError: the recording cannot be written.
    """
    wiring = wire(rig, clock, control, seed)
    streams = [stream for stream in wiring.cycle.rig.streams if stream.name in kept.record]
    if kept.resume:
        writer = RecordingWriter.append(kept.path, streams=streams, metadata=kept.metadata)
    else:
        writer = RecordingWriter.create(
            kept.path,
            streams=streams,
            metadata=kept.metadata,
            attachments=kept.attachments,
            start_ns=clock.start_ns,
            compression=kept.compression,
        )
    host = InProcessHost(wiring.cycle, clock, virtual=virtual, sink=writer, record=kept.record)
    plant = wiring.plant
    if plant is None:
        return RunSetup(host, None)
    return RunSetup(host, plant.change, plant.begin_trial)


def processes(
    rig: RigConfig,
    control: Control,
    seed: int,
    *,
    start_ns: int,
    kept: RecordingSpec,
    command: str,
    held: RunFolder | None = None,
) -> RunSetup:
    """Return a host whose cycle and recorder are running processes of their own.

    Samples that an earlier run on this rig left in its rings are added to their recording first.
    ``held`` is the rig's folder if the caller has taken it, and keeps it.

    Raises:
        Blocked: the rig is in use.
        RecordingError: the recording cannot be written.
    """
    from rigd.engine.process.launch import launch, prepare
    from rigd.engine.recorder import RecorderProcess, drain_leftovers
    from rigd.engine.shared import Job, RunFolder

    folder = held or RunFolder.take(rig.name, command=command, recording=kept.path)
    release = ExitStack()
    if held is None:
        release.callback(folder.release)
    try:
        if folder.has_job:
            completed = drain_leftovers(folder)
            if completed is not None:
                control.notices.append(
                    f"{completed}: samples that a killed run left in memory were added"
                )
        streams = tuple(item for item in streams_of(rig) if item.name in kept.record)
        job = Job(
            rig.name,
            kept.path,
            streams,
            start_ns,
            kept.metadata,
            kept.attachments,
            kept.compression,
            kept.resume,
        )
        prepare(rig, folder, job, record=kept.record, ring_s=RING_S)
        recorder = RecorderProcess(folder)
        host = None
        try:
            recorder.start()
            host = launch(
                rig,
                folder,
                job,
                control,
                record=kept.record,
                seed=seed,
                watched=(_KeptAlive(recorder, control),),
                finish=recorder.finish,
            )
            recorder.wait_until_recording()
        except BaseException:
            if host is not None:
                host.discard()
            recorder.discard()
            folder.clear()  # nothing was sampled
            raise
    except BaseException:
        release.close()
        raise
    if rig.simulation is None:
        if rig.plant is None:
            return RunSetup(host, None, release=release.close)
        return RunSetup(host, host.change, host.draw, release=release.close)
    simulation = rig.simulation.simulation_class(rig.simulation.config)

    def ask(request: Mapping[str, Any]) -> Mapping[str, Any]:
        return host.meanwhile(lambda: simulation.ask(request))

    faults = ShownFaults(ask)
    release.callback(faults.clear)  # before the rig is free for another run
    return RunSetup(host, _change(ask), faults=faults, release=release.close)


class _KeptAlive:
    """Starts the recorder again if it has ended or hangs; meanwhile its rows wait in the rings."""

    def __init__(self, recorder: RecorderProcess, control: Control) -> None:
        self._recorder = recorder
        self._control = control

    def poll(self) -> str | None:
        """Restart it if it has ended or hangs; a run ends only if nothing can be recorded.

        Raises:
            RecordingError: the recording cannot be written; the message is the recorder's.
        """
        from rigd.engine.recorder import Health

        health = self._recorder.poll()
        if health is Health.FAILED:
            self._recorder.wait_until_recording()  # raises the reason
        if health in (Health.DIED, Health.SILENT):
            self._control.notices.append(
                f"the recorder {self._recorder.fate or 'gives no sign of life'}, and is started "
                "again; no sample is lost"
            )
            self._recorder.restart()
        return None


def _change(ask: Ask) -> ChangePlant:
    """Return the function that changes devices simulated at the wire after a prompt."""

    def change(quantity: str, value: float | str) -> None:
        try:
            ask({"do": "change", "quantity": quantity, "value": value})
        except LinkError as error:
            raise ValueError(f"the simulation does not answer: {error}") from error

    return change
