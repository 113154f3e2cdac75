"""The run's folder: one run per rig, private, with names that no file could have."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from rigd.engine.shared import (
    InUse,
    Job,
    Phase,
    RunFolder,
    Word,
    leftovers,
    served_rigs,
    state_folder,
)
from rigd.model import Channel, RecordingError, Stream
from rigd.model.errors import Blocked
from rigd.record import Attachment

STREAMS = (
    Stream("servo", (Channel("current", "A", "µ", -10.0, 10.0),), has_status=True, source="x"),
    Stream("force", (Channel("normal", "N", raw_of="volts"),)),
)


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RIGD_STATE", str(tmp_path / "state"))
    return tmp_path / "state"


def job_in(tmp_path: Path) -> Job:
    return Job(
        rig="bench",
        recording=tmp_path / "run.mcap",
        streams=STREAMS,
        start_ns=1_790_000_000_000_000_000,
        metadata={"run": {"rig": "bench"}},
        attachments=(Attachment("rig.yaml", "application/yaml", b"\x00\xff"),),
        compression="lz4",
    )


def test_prepared_folder_is_found_by_other_processes(tmp_path: Path, state: Path) -> None:
    mine = RunFolder.take("bench", command="test")
    job = job_in(tmp_path)
    mine.prepare(job, {"servo": 100, "force": 50})
    (theirs,) = leftovers()
    assert theirs.path == mine.path == state / "bench"
    assert theirs.job == job
    rings = theirs.row_rings(theirs.job)
    assert {name: ring.capacity for name, ring in rings.items()} == {"servo": 100, "force": 50}
    mine.event_ring("daemon").push(1, "note", 0, {})
    assert [event.kind for event in theirs.event_ring("daemon").peek()] == ["note"]
    mine.board()[Word.PHASE] = Phase.ENDED
    mine.board()[Word.MISSED] = -1
    assert theirs.board()[Word.PHASE] == Phase.ENDED
    assert theirs.board()[Word.MISSED] == -1
    with pytest.raises(RecordingError, match="rigd recover"):
        mine.prepare(job, {"servo": 100, "force": 50})
    mine.clear()
    assert [path.name for path in mine.path.iterdir()] == ["lock"]
    assert list(leftovers()) == []


HOLD = """
import sys
from pathlib import Path
from rigd.engine.shared import RunFolder
folder = RunFolder.take("bench", command="rigd run sweep.yaml", recording=Path("/data/run.mcap"))
print("held", flush=True)
if sys.argv[1] == "pass on":
    import subprocess
    child = subprocess.Popen(["cat"], pass_fds=[folder.lock_fd], stdout=subprocess.DEVNULL)
else:
    sys.stdin.read()
"""


def test_rig_in_use_is_refused_with_its_holder() -> None:
    command = [sys.executable, "-c", HOLD, "hold"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        expected = rf"bench is in use by process {other.pid} \(rigd run sweep.yaml, recording /data"
        with pytest.raises(Blocked, match=expected):
            RunFolder.take("bench", command="test")
        RunFolder.take("another", command="test").release()
        other.kill()
    RunFolder.take("bench", command="test").release()


def test_holder_of_rig_may_state_an_alternative() -> None:
    held = RunFolder.take("bench", command="rigd serve")
    held.mark("rigd serve", hint="ask it: rigd remote start")
    with pytest.raises(InUse, match=r"rigd serve.*\n.*rigd remote start") as caught:
        RunFolder.take("bench", command="test")
    assert caught.value.lives
    held.mark("rigd serve", Path("/data/run.mcap"))
    with pytest.raises(InUse, match=r"rigd serve, .*/data/run\.mcap"):
        RunFolder.take("bench", command="test")
    held.release()


def test_served_rigs_are_those_of_living_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIGD_STATE", str(tmp_path / "state"))
    assert served_rigs() == {}
    held = RunFolder.take("bench", command="rigd serve")
    assert served_rigs() == {}
    served = ("bench", "tcp/127.0.0.1:7450")
    held.mark("rigd serve", Path("/data/run.mcap"), served=served)
    other = RunFolder.take("other", command="rigd run")
    assert served_rigs() == {"bench": "tcp/127.0.0.1:7450"}
    held.mark("rigd serve", served=served)
    text = (held.path / "lock").read_text()
    (held.path / "lock").write_text(text.replace(str(os.getpid()), str(2**22 + 1)))  # it has died
    assert served_rigs() == {}
    (held.path / "lock").write_text(text[:20])
    assert served_rigs() == {}
    for folder in (held, other):
        folder.release()


def test_rig_that_cannot_be_marked_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as broken:
        broken.setattr(os, "pwrite", full)
        with pytest.raises(RecordingError, match="lock: No space left"):
            RunFolder.take("bench", command="test")
    RunFolder.take("bench", command="test").release()


def test_child_of_dead_process_is_waited_for() -> None:
    command = [sys.executable, "-c", HOLD, "pass on"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.wait() == 0
        with pytest.raises(InUse) as caught:
            RunFolder.take("bench", command="test", patience_s=0.2)
        assert not caught.value.lives
        assert other.stdin is not None
        ends = threading.Timer(0.2, other.stdin.close)
        ends.start()
        RunFolder.take("bench", command="test", patience_s=30.0).release()
        ends.join()


def test_a_dead_process_its_parent_ignores_is_dead() -> None:
    """As under a supervisor that does not read how its processes ended."""
    command = [sys.executable, "-c", HOLD, "pass on"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        os.waitid(os.P_PID, other.pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(InUse, match="which died") as caught:
            RunFolder.take("bench", command="test")
        assert not caught.value.lives
        assert other.stdin is not None
        other.stdin.close()
        RunFolder.take("bench", command="test", patience_s=30.0).release()


def test_rig_is_in_use_until_last_process_ends() -> None:
    command = [sys.executable, "-c", HOLD, "pass on"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.wait() == 0
        with pytest.raises(Blocked, match=f"process {other.pid} .* died; they are still"):
            RunFolder.take("bench", command="test")
        assert other.stdin is not None
        other.stdin.close()
        RunFolder.take("bench", command="test", patience_s=30.0).release()


@pytest.mark.parametrize("rig", ["Prüf/stand 2", "..", ".", ".hidden", "a%2Fb", "日" * 200])
def test_odd_names_make_folders_of_their_own(rig: str, state: Path) -> None:
    names = [rig, f"{rig}x", "a/b"]
    folders = [RunFolder.take(name, command="test") for name in names]
    assert len({folder.path.resolve() for folder in folders}) == 3
    assert all(folder.path.resolve().parent == state.resolve() for folder in folders)
    for folder in folders:
        folder.release()


def test_state_folder_writable_by_others_is_refused(state: Path) -> None:
    state.mkdir(mode=0o700)
    state.chmod(0o777)
    with pytest.raises(Blocked, match="not private"):
        RunFolder.take("bench", command="test")
    state.chmod(0o700)
    RunFolder.take("bench", command="test").release()


def test_a_state_folder_of_another_user_is_refused(
    state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state.mkdir(mode=0o700)
    stranger = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: stranger)
    with pytest.raises(Blocked, match="not private"):
        state_folder()


def test_link_in_place_of_state_folder_is_refused(state: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    state.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(Blocked, match="not private"):
        state_folder()


def test_without_a_setting_the_folder_is_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RIGD_STATE")
    if os.access("/dev/shm", os.W_OK):
        assert state_folder() == Path(f"/dev/shm/rigd-{os.geteuid()}")


def test_ring_without_room_is_reported(tmp_path: Path) -> None:
    folder = RunFolder.take("bench", command="test")
    with pytest.raises(RecordingError, match=r"cannot make .*rows-0"):
        folder.prepare(job_in(tmp_path), {"servo": 1 << 45, "force": 1})
    assert not folder.has_job
    folder.release()
