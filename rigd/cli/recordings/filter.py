"""``rigd filter``: computes the observers of a rig from a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_rig, rig_of

if TYPE_CHECKING:
    from rigd.analysis.recordings.observers import Filtered
    from rigd.record import Recording

HELP = "compute the observers of a rig file from a recording, into a new recording"
EXAMPLES = """\
examples:
  rigd filter runs/20261121-080000-quick.mcap --rig my_rig.yaml
  rigd filter FILE --rig my_rig.yaml --observer slip_filter --output slip.mcap

  Each observer of the rig file is computed cycle by cycle, as in a run. The new recording has their
  streams, and the events and trials of the old one, which is not changed. Tried on a
  recording, a filter needs no rig: change its noise in the file, and compute again.
  The table has for each trial the mean of the NIS over the number of measured channels, which is 1
  if the model fits, and the largest standard deviation of each state.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("file", type=Path, metavar="FILE", help="recording")
    add_rig(parser, "rig file with `observers`, or the rig's name")
    parser.add_argument(
        "--observer", action="append", metavar="NAME", help="only this one (default: all)"
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="default: FILE-filtered.mcap beside FILE"
    )
    add_json(parser, "print the table as JSON")


def execute(args: argparse.Namespace) -> int:
    """Compute, write and print."""
    import json

    from rigd.analysis.recordings.observers import filtered, observers_of
    from rigd.config.loader import load_rig
    from rigd.config.problems import suggest
    from rigd.model.errors import ConfigError
    from rigd.record import Recording

    rig = load_rig(rig_of(args))
    known = observers_of(rig)
    if not known:
        raise ConfigError(
            f"{rig.source.path} has no observers", hint="write them below `observers:`"
        )
    for name in args.observer or ():
        if name not in known:
            raise ConfigError(f"--observer {name}: no such observer", hint=suggest(name, known))
    recording = Recording.open(args.file)
    found = [filtered(recording, rig, name) for name in args.observer or known]
    output = args.output or args.file.with_name(f"{args.file.stem}-filtered.mcap")
    _write(recording, found, output, rig.source.text)
    table = {item.name: _trials(recording, item) for item in found}
    if args.json:
        print(json.dumps({"recording": str(output), "observers": table}, indent=2))
        return 0
    _print(table)
    print(f"recording: {output}")
    return 0


def _write(recording: Recording, found: list[Filtered], output: Path, rig_text: str) -> None:
    from rigd.model.machine.folders import make_folder
    from rigd.record import Attachment, RecordingWriter
    from rigd.record.mcap.prefix import FORMAT_METADATA, RECOVERY_METADATA

    own = (FORMAT_METADATA, RECOVERY_METADATA)
    metadata = {name: data for name, data in recording.metadata.items() if name not in own}
    metadata["filtered"] = {"from": str(recording.path)}
    kept = [item for name, item in recording.attachments.items() if name != "rig.yaml"]
    rig = Attachment("rig.yaml", "application/yaml", rig_text.encode())
    models = [
        Attachment(path.name, "text/plain", text.encode())
        for item in found
        for path, text in item.config.files().items()
    ]
    make_folder(output.parent, "--output")
    with RecordingWriter.create(
        output,
        streams=[item.stream for item in found],
        metadata=metadata,
        attachments=[*kept, rig, *models],
        start_ns=recording.start_ns,
    ) as writer:
        for event in recording.events():
            writer.event(event.t_ns, event.kind, event.trial, event.data)
        for item in found:
            writer.write(item.name, item.rows)


def _trials(recording: Recording, item: Filtered) -> list[dict[str, float | str]]:
    """Return a row for each trial, or one for all without trials."""
    import numpy as np

    end_ns = recording.end_ns + 1
    trials = [trial.info for trial in recording.trials]
    spans = [(f"trial {t.number}", t.start_ns, t.end_ns or end_ns) for t in trials]
    spans = spans or [("all", recording.start_ns, end_ns)]
    rows: list[dict[str, float | str]] = []
    count = len(item.config.measured)
    for name, begin, end in spans:
        first, last = np.searchsorted(item.rows["t_ns"], [begin, end])
        part = item.rows[first:last]
        if not len(part):
            continue
        values = part["nis"]
        found = values[np.isfinite(values)]
        nis = float(np.mean(found)) / count if len(found) else float("nan")
        row: dict[str, float | str] = {"trial": name, "nis": nis}
        for channel in item.config.channels:
            if channel.name.endswith("_sd"):
                sizes = part[channel.name]
                largest = np.max(sizes, where=np.isfinite(sizes), initial=0.0)
                row[f"{channel.name} ({channel.unit})"] = float(largest)
        rows.append(row)
    return rows


def _print(table: dict[str, list[dict[str, float | str]]]) -> None:
    from rigd.cli.views.screen import folding_table, open_console, print_table

    console = open_console()
    for name, rows in table.items():
        console.print(name)
        shown = folding_table(*(rows[0] if rows else ("trial",)))
        for row in rows:
            shown.add_row(*(f"{v:.3g}" if isinstance(v, float) else v for v in row.values()))
        print_table(console, shown)
