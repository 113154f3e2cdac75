"""``rigd layout``: writes a layout for a viewer, with the channels of a rig."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigd.model import Stream

HELP = "write a layout for Foxglove or PlotJuggler, with the channels of a rig"
EXAMPLES = """\
examples:
  rigd layout lugre-1 --to foxglove                   lugre-1.foxglove.json
  rigd layout configs/sim_lugre.yaml --to plotjuggler
  rigd layout FILE --to foxglove                      with what this recording has

  Foxglove: Layouts, Import from file. PlotJuggler: load the recording with all its topics, then
  the layout. Both show first which trial and step it is, then a tab with one plot of each device
  and a tab for each device with all its channels, commanded beside measured. Values are in SI.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("rig", metavar="RIG", help="rig file, the rig's name, or a recording")
    parser.add_argument(
        "--to", choices=("foxglove", "plotjuggler"), required=True, help="the viewer"
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="FILE",
        help="file of the layout (default: the rig's name and that of the viewer)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a file that exists")


def execute(args: argparse.Namespace) -> int:
    """Write the layout and print its name."""
    from rigd.model.errors import ConfigError, RecordingError
    from rigd.model.machine.folders import make_folder
    from rigd.record.layout import FORMATS, layout

    name, streams = _named_streams(args.rig)
    path: Path = args.output or Path(f"{name}.{args.to}{FORMATS[args.to].suffix}")
    make_folder(path.parent, "--output")
    try:
        with path.open("w" if args.overwrite else "x", encoding="utf-8", newline="\n") as file:
            file.write(layout(streams, args.to))
    except FileExistsError as error:
        raise ConfigError(f"{path} exists already", hint="--overwrite replaces it") from error
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}") from error
    print(path)
    return 0


def _named_streams(given: str) -> tuple[str, Sequence[Stream]]:
    """Return the name of a rig or recording, and its streams.

    Raises:
        ConfigError: there is no such rig, or its file is wrong.
        RecordingError: the recording cannot be read, or has no streams.
    """
    from rigd.model.errors import RecordingError

    if given.endswith(".mcap"):
        from rigd.record import Recording

        recording = Recording.open(given)
        if not recording.streams:
            raise RecordingError(f"{given} has no stream that a layout could show")
        return recording.path.stem, list(recording.streams.values())
    from rigd.config.loader import load_rig
    from rigd.engine.cycle.wiring import streams_of

    rig = load_rig(given)
    return rig.name, streams_of(rig)
