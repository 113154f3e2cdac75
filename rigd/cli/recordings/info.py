"""``rigd info``: prints the contents of a recording."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from rigd.cli.options import add_json

if TYPE_CHECKING:
    from rich.console import Console

    from rigd.record import Recording, RunInfo

#: Rich takes 0.5 ms for a line of a table, and a person reads no more of them.
_MOST_LINES = 2000
HELP = "show the contents of a recording"
EXAMPLES = """\
examples:
  rigd info runs/20261121-080000-quick.mcap
  rigd info FILE --json
  rigd info runs/*.mcap
  rigd info FILE --attachments folder/      write its rig and procedure files
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    add_json(parser, "print as JSON; a list for several files")
    parser.add_argument(
        "--attachments", type=Path, metavar="FOLDER", help="write the attached files to this folder"
    )


def execute(args: argparse.Namespace) -> int:
    """Print each summary; a file that cannot be read does not stop the others."""
    from rigd.model.errors import ConfigError, Exit, RecordingError
    from rigd.record import info_json

    files: list[Path] = list(dict.fromkeys(args.files))
    if args.attachments is not None and len(files) > 1:
        raise ConfigError(
            "--attachments is for one recording", hint="give one FILE with --attachments"
        )
    found = []
    for file in files:
        try:
            recording = _opened(file)
            info = recording.info
        except RecordingError as error:
            if len(files) == 1:
                raise
            print(f"rigd: {error}", file=sys.stderr)
            continue
        found.append(info_json(info))
        if not args.json:
            print("\n" if len(found) > 1 else "", end="")
            _print(info)
        if args.attachments is not None:
            _write_attachments(recording, args.attachments)
    if args.json:
        print(json.dumps(found[0] if len(files) == 1 else found, indent=2))
    return int(Exit.OK if len(found) == len(files) else Exit.BAD_DATA)


def _opened(path: Path) -> Recording:
    """Open a recording; open a torn recording as far as it is intact."""
    from rigd.model.errors import RecordingError
    from rigd.record import Recording

    try:
        return Recording.open(path)
    except RecordingError:
        return Recording.open(path, partial=True)  # raises again if the file is not a recording


def _write_attachments(recording: Recording, folder: Path) -> None:
    from rigd.model.about import plain
    from rigd.model.errors import RecordingError
    from rigd.model.machine.folders import make_folder
    from rigd.record.read.attachments import file_names

    targets = {name: folder / path for name, path in file_names(recording.attachments).items()}
    for target in targets.values():
        if os.path.lexists(target):
            raise RecordingError(
                f"{target} exists already", hint="give --attachments another FOLDER"
            )
    for name, target in targets.items():
        attachment = recording.attachments[name]
        make_folder(target.parent, "FOLDER")
        try:
            with target.open("xb") as file:  # never through a link that is there
                file.write(attachment.data)
        except OSError as error:
            raise RecordingError(
                f"{target} cannot be written: {error.strerror}",
                hint="give --attachments another FOLDER",
            ) from error
        renamed = "" if str(target) == str(folder / name) else f", which is named {plain(name)!r}"
        print(f"wrote {target}{renamed}")


def _print(info: RunInfo) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.views.screen import print_table
    from rigd.model.about import plain
    from rigd.record.mcap.access import how_to_recover
    from rigd.record.read.condition import foreign_lines
    from rigd.record.read.moment import is_virtual

    console = Console(highlight=False)
    named = quote(str(info.path))
    mode = info.mode.replace("simulated", "SIMULATED")  # as reports have it
    facts = {
        "recording": f"{info.path}, {info.size / 1e6:.2f} MB, {info.duration_s:.1f} s",
        "procedure": info.procedure,
        "rig": info.rig,
        "mode": mode + (f", seed {info.seed}" if info.seed else ""),
        "from": info.metadata.get("run", {}).get("imported_from", ""),
        "started": info.started + (", the clock of the run" if is_virtual(info) else ""),
        "warned": info.metadata.get("import", {}).get("warnings", ""),
        "times": info.metadata.get("import", {}).get("times", ""),
        "recorded": _recorded(info),
        "operator": info.metadata.get("run", {}).get("operator", ""),
        "specimen": _specimen(info.specimen),
        "note": info.metadata.get("run", {}).get("note", ""),
        "meta": ", ".join(f"{k}={v}" for k, v in info.metadata.get("meta", {}).items()),
        "run": info.state + (f": {info.reason}" if info.reason else ""),
        "verdict": info.verdict,
        "file": _file(info),
        "trials": _counted(info),
        "parameters": ", ".join(f"{name} = {value}" for name, value in info.parameters.items()),
        "--set": ", ".join(
            f"{name}={value}" for name, value in info.metadata.get("overrides", {}).items()
        ),
        "calibration": _calibration(info.metadata.get("calibration", {})),
        "not read": ", ".join(map(str, info.topics)),
        "attached": ", ".join(info.attachments),
    }
    lines = [*facts.items(), *(("added note", str(note)) for note in info.notes)]
    for name, text in lines:
        if text:
            console.print(f"{name:<12}{escape(plain(text))}", soft_wrap=True)
    for text in foreign_lines(info.foreign):
        console.print(escape(plain(text)), soft_wrap=True)
    if info.recovered and not info.losses:
        console.print("[yellow]this file was damaged and has been recovered[/]")
    for text in info.losses:
        console.print(f"[red]{escape(plain(text))}[/]", soft_wrap=True)
    if info.problem:
        advice = f"`rigd verify {named}` prints details. {how_to_recover(info.path)}"
        console.print(escape(plain(advice)), soft_wrap=True)
    _print_trials(console, info)
    table = Table(box=None, pad_edge=False)
    table.add_column("stream")
    table.add_column("rows", justify="right")
    table.add_column("rate", justify="right")
    table.add_column("channels", overflow="fold")
    for stream in info.streams[:_MOST_LINES]:
        channels = ", ".join(f"{c.name} [{c.shown_in}]" for c in stream.stream.channels)
        table.add_row(
            escape(stream.stream.name),
            str(stream.rows),
            f"{stream.rate_hz:.0f} Hz",
            escape(channels),
        )
    print_table(console, table)
    _say_rest(len(info.streams), "streams", named)


def _print_trials(console: Console, info: RunInfo) -> None:
    """Print a line for each attempt at a trial."""
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.views.screen import print_table
    from rigd.model.about import plain

    if not info.trials:
        return
    names = [  # events of the whole run are printed above
        name
        for name in dict.fromkeys(name for trial in info.trials for name in trial.parameters)
        if name not in info.parameters or len({trial.text(name) for trial in info.trials}) > 1
    ]
    table = Table(box=None, pad_edge=False)
    for name in ("trial", "s", *names):
        table.add_column(escape(plain(name)), justify="right")
    table.add_column("", overflow="fold")
    for trial in info.trials[:_MOST_LINES]:
        lasted = "" if trial.end_ns is None else f"{(trial.end_ns - trial.start_ns) * 1e-9:.2f}"
        values = (trial.text(name) for name in names)
        whole = trial.reason or "played"  # its rows are not checked here
        state = whole if trial.complete else f"not complete: {trial.reason or 'no end'}"
        texts = (str(trial.number), lasted, *values, state)
        table.add_row(*(escape(plain(text)) for text in texts))
    print_table(console, table)
    _say_rest(len(info.trials), "trials", quote(str(info.path)))


def _say_rest(count: int, things: str, named: str) -> None:
    """Say how many of a table are not printed."""
    if count > _MOST_LINES:
        print(f"and {count - _MOST_LINES} {things}: `rigd info {named} --json` lists all")


def _file(info: RunInfo) -> str:
    """Return what the file is, and what wrote it."""
    from rigd.record.read.condition import FileCondition, writer_of

    written = f"written by {writer_of(info.foreign)}"
    if info.condition is FileCondition.UNCHECKED:
        return f"{written}, not checked (`rigd verify {quote(str(info.path))}` does)"
    return f"{info.condition}, {written}"


def _specimen(held: Mapping[str, str]) -> str:
    """Return the name of the specimen, and what its file says of it."""
    known = ", ".join(f"{name} {text}" for name, text in held.items() if name != "name")
    return held.get("name", "") + (f": {known}" if known else "")


def _counted(info: RunInfo) -> str:
    """Return how many trials there are; those are not complete that ended early or lost rows."""
    missing = len(info.trials) - info.trials_done
    return f"{len(info.trials)} begun" + (f", {missing} not complete" if missing else "")


def _recorded(info: RunInfo) -> str:
    """Return when a run in virtual time was made, if the file says so; its start is no date."""
    from rigd.record.read.moment import is_virtual, recorded_at

    if not is_virtual(info):
        return ""
    moment = recorded_at(info)
    return f"{moment.at:%Y-%m-%d %H:%M} UTC, the date of the {moment.of}"


def _calibration(held: Mapping[str, str]) -> str:
    """Describe the calibration that a run used."""
    if not held:
        return ""
    last = held.get("valid_until")
    valid = f", valid until {last}" if last else ""
    return f"{held['name']} of {held['made']}{valid}, sha256 {held['sha256'][:12]}"
