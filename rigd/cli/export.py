"""``rigd export``: recordings as tables for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

HELP = "export a recording to Parquet, CSV or MATLAB files"
EXAMPLES = """\
examples:
  rigd export runs/20261121-080000-quick.mcap --to parquet
  rigd export FILE --to csv --stream carriage --stream wheel_servo --output tables/
  rigd export FILE --to mat

  One table per stream, with t_ns (UTC), time (s), trial (-1 outside) and a column per channel.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("file", type=Path, help="recording")
    parser.add_argument("--to", choices=("parquet", "csv", "mat"), required=True, help="format")
    parser.add_argument(
        "--stream", action="append", metavar="NAME", help="only this stream (default: all)"
    )
    parser.add_argument(
        "--output", type=Path, metavar="FOLDER", help="default: a folder named like the recording"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")


def execute(args: argparse.Namespace) -> int:
    """Write the tables and name them."""
    from rigd.record import Recording
    from rigd.record.export import export

    folder = args.output or args.file.with_suffix("")
    written = export(
        Recording.open(args.file),
        folder,
        args.to,
        streams=args.stream,
        overwrite=args.overwrite,
    )
    for path in written:
        print(path)
    return 0
