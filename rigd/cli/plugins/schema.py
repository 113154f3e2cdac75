"""``rigd schema``: prints the JSON Schema with which an editor checks rigd's files."""

from __future__ import annotations

import argparse
import json

HELP = "print the JSON Schema of procedure, rig, calibration or map files, or of remote messages"
EXAMPLES = """\
examples:
  rigd schema procedure > procedure.schema.json

  Then begin a procedure with the line
    # yaml-language-server: $schema=procedure.schema.json
  and the editor completes keys, shows their documentation and underlines mistakes.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "kind",
        choices=("procedure", "rig", "calibration", "map", "remote"),
        help="kind of file; remote: the messages of the remote protocol",
    )


def execute(args: argparse.Namespace) -> int:
    """Print the schema."""
    if args.kind == "rig":
        from rigd.config.schema import rig_schema as schema
    elif args.kind == "calibration":
        from rigd.config.schema import calibration_schema as schema
    elif args.kind == "map":
        from rigd.importing.source import map_schema as schema
    elif args.kind == "remote":
        from rigd.remote.protocol.schema import remote_schema as schema
    else:
        from rigd.procedure.source import procedure_schema as schema
    print(json.dumps(schema(), indent=2, ensure_ascii=False))
    return 0
