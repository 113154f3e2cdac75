"""A campaign of the approach-angle rig in MCAP of another program, against rigd's own file.

    python benchmarks/foreign_recording.py             ten runs; some minutes on one core
    python benchmarks/foreign_recording.py --trials 80
    python benchmarks/foreign_recording.py --odd       the odd variants alone: 12 CPU minutes
    python benchmarks/foreign_recording.py --odd --part 0/6    every sixth of them

The same messages are written again with the `mcap` package: in order of time, so that channels mix
within each chunk, other numbers of schemas and channels, other chunk sizes and compressions. Every
trial of every stream is read, and `rigd identify` evaluates both. Times are CPU seconds, the best
of three interleaved rounds.

Then a run of the omni-wheel rig is written in each odd but valid way of
`tests/support/recordings/odd_mcap.py`. Each command is to give what it gives for rigd's own file:
`verify` finds nothing damaged, `open` gives the same rows and trials, `export` the same tables,
`identify` the same numbers, and `recover` leaves the file as it is. Last, each is cut off and
repaired: every message that the `mcap` package finds before the cut must be in the repaired file.
`info`, `runs`, `measure`, `compare` and `report` are played on runs that have measures.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from figures import at_least, at_most, noted
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.commands.odd_commands import COMMANDS, of_run
from support.recordings.odd_mcap import VALID, content_of, messages_in
from support.recordings.shipped_runs import Pair, play

from rigd.config.loader import load_rig
from rigd.model.errors import RigdError
from rigd.record import Recording
from rigd.sdk.shipped_files import shipped_folder

ROUNDS = 3
RIGD = Path(sys.executable).with_name("rigd")
#: How another program may write.
VARIANTS: dict[str, dict[str, Any]] = {
    "chunks of 1 MiB, zstd": {"compression": CompressionType.ZSTD},
    "chunks of 1 MiB, lz4": {"compression": CompressionType.LZ4},
    "chunks of 1 MiB, plain, no CRC": {
        "compression": CompressionType.NONE, "enable_crcs": False,
    },
    "chunks of 16 KiB, zstd": {"chunk_size": 1 << 14},
    "one chunk, zstd": {"chunk_size": 1 << 30},
}  # fmt: skip


def write_again(source: Path, target: Path, **options: Any) -> None:
    """Write all of a recording with the mcap package, messages in order of time."""
    with source.open("rb") as file, target.open("wb") as out:
        reader = make_reader(file)
        summary = reader.get_summary()
        if summary is None:
            raise ValueError(f"{source} has no summary")
        writer = Writer(out, **{"chunk_size": 1 << 20, **options})
        writer.start("", "another program")
        numbers = {}
        for channel in reversed(summary.channels.values()):
            schema = summary.schemas[channel.schema_id]
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            numbers[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, number, dict(channel.metadata)
            )
        for item in reader.iter_attachments():
            writer.add_attachment(
                item.create_time, item.log_time, item.name, item.media_type, item.data
            )
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, dict(record.metadata))
        for _, channel, message in reader.iter_messages(log_time_order=True):
            writer.add_message(
                numbers[channel.id], message.log_time, message.data, message.publish_time,
                message.sequence,
            )  # fmt: skip
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped


def read(path: Path) -> list[np.ndarray[Any, Any]]:
    """Return all rows of all streams, trial by trial."""
    recording = Recording.open(path)
    return [
        recording.read(stream, trial.info.start_ns, trial.info.end_ns)
        for trial in recording.trials
        for stream in sorted(recording.streams)
    ]


def read_s(path: Path) -> float:
    """Return the CPU time of :func:`read`."""
    start = time.process_time()
    read(path)
    return time.process_time() - start


def identify_s(path: Path) -> float:
    """Return the CPU time of `rigd identify`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [str(RIGD), "identify", str(path), "--no-report", "--json"]
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def ran(*command: str | Path) -> tuple[int, str]:
    """Return exit code and output of a command."""
    done = subprocess.run([str(RIGD), *map(str, command)], check=False, capture_output=True)
    return done.returncode, done.stdout.decode()


def tables(path: Path) -> dict[str, bytes]:
    """Return what `rigd export` writes; the metadata name the file, and are left out."""
    target = path.with_suffix("")
    code, _ = ran("export", path, "--to", "csv", "--output", target, "--overwrite")
    if code:
        return {}
    return {item.name: item.read_bytes() for item in target.glob("*.csv")}


def estimates(path: Path) -> object:
    """Return the exit code of `rigd identify` and its parameters, from one start to save time."""
    code, text = ran("identify", path, "--no-report", "--json", "--starts", "1")
    try:
        return code, json.loads(text)["parameters"]
    except (ValueError, KeyError, TypeError):
        return code, None


def opened(path: Path) -> object:
    """Return rows, events and trials as Python gives them; the error if it gives none."""
    try:
        recording = Recording.open(path)
        rows = [recording.read(name).tobytes() for name in sorted(recording.streams)]
        return rows, recording.events(), [trial.info for trial in recording.trials]
    except RigdError as error:
        return str(error)


def keeps_all(path: Path) -> bool:
    """Cut a file off; return whether `rigd recover` keeps what the `mcap` package finds."""
    data = path.read_bytes()[: path.stat().st_size * 2 // 3]
    cut = path.with_name("cut.mcap")
    for item in path.parent.glob("cut.mcap*"):
        item.unlink()
    cut.write_bytes(data)
    before = {topic: set(found) for topic, found in messages_in(data).items()}
    code, _ = ran("recover", cut)
    if not before:  # the only chunk is cut: then the file is to be left as it is
        return code != 0 and cut.read_bytes() == data
    after = {topic: set(found) for topic, found in messages_in(cut.read_bytes()).items()}
    return code == 0 and all(found <= after.get(topic, set()) for topic, found in before.items())


def play_odd(folder: Path, part: int, parts: int) -> None:
    """Write runs in each odd way, and count for how many each command gives what it should."""
    ours, other, moved = (folder / name / "a.mcap" for name in ("ours", "other", "moved"))
    theirs = folder / "theirs" / "a.mcap"
    for path in (ours, other, moved, theirs):
        path.parent.mkdir()
    record(ours, "breakaway", 1, 2)
    record(other, "breakaway", 2, 2)
    record(moved, "constant_current", 1, 6)
    measured, content = content_of(ours), content_of(moved)
    shutil.copy2(ours, theirs)  # what they give also names the file
    shown = {name: of_run(call(theirs, other)) for name, call in COMMANDS.items()}
    expected = opened(moved), tables(moved), estimates(moved)
    right: Counter[str] = Counter()
    odd = dict(list(VALID.items())[part::parts])
    for name, make in odd.items():
        shutil.rmtree(theirs.parent)  # `runs` lists all that stands beside it
        theirs.parent.mkdir()
        make(measured, theirs)
        os.utime(theirs, ns=(ours.stat().st_mtime_ns,) * 2)  # the date of a run in virtual time
        found = {
            command: of_run(call(theirs, other)) == shown[command]
            for command, call in COMMANDS.items()
        }
        make(content, theirs)
        before = theirs.read_bytes()
        found |= {
            "verify": ran("verify", theirs)[0] == 0,
            "open": opened(theirs) == expected[0],
            "export": tables(theirs) == expected[1],
            "identify": estimates(theirs) == expected[2],
            "recover": ran("recover", theirs)[0] == 0 and theirs.read_bytes() == before,
            "cut, recover": keeps_all(theirs),
        }
        wrong = ", ".join(command for command, is_right in found.items() if not is_right)
        print(f"{name}: {wrong or 'right'}", flush=True)
        right.update(found)
    for command, count in right.items():
        at_least(f"odd files, {command}", count, len(odd), f"of {len(odd)}")


def record(path: Path, procedure: str, seed: int, trials: int) -> None:
    """Play a shipped procedure on the simulated omni-wheel rig."""
    rig = load_rig(shipped_folder("configs") / "sim_lugre.yaml")
    play(Pair(shipped_folder("procedures") / f"{procedure}.yaml", rig), seed, path, trials=trials)


def main() -> int:
    """Record, write again, time both."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trials", type=int, default=10, help="runs of the campaign (default 10)")
    parser.add_argument("--odd", action="store_true", help="the odd variants alone")
    parser.add_argument("--part", default="0/1", help="of the odd variants: from 0/6 to 5/6")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        play_odd(Path(folder), *map(int, arguments.part.split("/")))
        if arguments.odd:
            return 0
        ours = Path(folder) / "ours.mcap"
        rig = load_rig(shipped_folder("configs") / "sim_approach_angle.yaml")
        pair = Pair(shipped_folder("procedures") / "approach_angles.yaml", rig)
        play(pair, 1, ours, trials=arguments.trials)
        theirs = {}
        for number, (name, options) in enumerate(VARIANTS.items()):
            theirs[name] = Path(folder) / f"theirs_{number}.mcap"
            write_again(ours, theirs[name], **options)
            same = zip(read(ours), read(theirs[name]), strict=True)
            if not all(np.array_equal(a, b) for a, b in same):
                raise SystemExit(f"{name}: not the same rows")
        files = {"": ours, **theirs}
        reading: dict[str, list[float]] = {name: [] for name in files}
        whole: dict[str, list[float]] = {name: [] for name in files}
        for _ in range(ROUNDS):
            for name, path in files.items():
                reading[name].append(read_s(path))
                whole[name].append(identify_s(path))
        noted("ours, read, s CPU", min(reading[""]), "s")
        noted("ours, identify, s CPU", min(whole[""]), "s")
        for name in theirs:
            noted(f"read, {name}", min(reading[name]) / min(reading[""]), "x of ours")
            at_most(f"identify, {name}", min(whole[name]) / min(whole[""]), 1.2, "x of ours")
    return 0


if __name__ == "__main__":
    sys.exit(main())
