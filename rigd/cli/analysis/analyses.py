"""``rigd analyses``: lists installed analyses and what each needs from a procedure."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

from rigd.cli.options import add_json

if TYPE_CHECKING:
    from rigd.cli.plugins.inventory import InstalledAnalysis

HELP = "list the installed analyses, and what each needs from a procedure"
EXAMPLES = """\
examples:
  rigd analyses                       names, packages and what each is
  rigd analyses lugre                 its signals, constants, parameters and options
  rigd analyses lugre --json

  `identify: {model: NAME}` in a procedure names an analysis. Any installed package may provide
  analyses: see docs/analyses.md and `rigd new analysis`.
  Exit code 2: the name does not exist, or the analysis cannot be loaded.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="show this analysis in full")
    add_json(parser, "print everything as JSON")


def execute(args: argparse.Namespace) -> int:
    """List the installed analyses; a broken one does not hide the others."""
    from importlib.metadata import entry_points

    from rigd.cli.plugins.inventory import look_at_analysis, print_list
    from rigd.cli.views.screen import open_console
    from rigd.config.problems import suggest
    from rigd.config.registry import ANALYSES
    from rigd.model.errors import ConfigError, Exit

    points = sorted(entry_points(group=ANALYSES), key=lambda point: point.name)
    wanted = [point for point in points if args.name in (None, point.name)]
    if not points and not args.json:
        print("no analyses are installed", file=sys.stderr)
    if not wanted and args.name is not None:
        raise ConfigError(
            f"there is no analysis {args.name!r}",
            hint=suggest(args.name, {point.name for point in points}),
        )
    found = [look_at_analysis(point) for point in wanted]
    if args.json:
        print(json.dumps([asdict(item) for item in found], indent=2, ensure_ascii=False))
    elif args.name is None:
        print_list(open_console(), found)
    else:
        for item in found:
            print("\n".join(_in_full(item)))
    broken = args.name is not None and any(item.broken for item in found)
    return int(Exit.BAD_INPUT if broken else Exit.OK)


def _in_full(analysis: InstalledAnalysis) -> Iterator[str]:
    yield f"{analysis.name}  analysis of {analysis.package} {analysis.version}"
    if analysis.broken:
        yield f"  broken: {analysis.broken}"
        return
    yield from (f"  {line}".rstrip() for line in analysis.doc.splitlines())
    for title, names in (
        ("signals", _with_units(analysis.signals, analysis.signals)),
        ("optional signals", _with_units(analysis.optional_signals, analysis.optional_signals)),
        ("constants", _with_units(analysis.constants, analysis.constant_units)),
        ("optional constants", _with_units(analysis.optional_constants, analysis.constant_units)),
        ("trial parameters", analysis.trial_parameters),
        ("calibrated values that it uses", analysis.calibrated),
        ("calibrated values that it measures", analysis.measures),
        ("published values that it compares with", analysis.references),
        ("options of `rigd identify`", [_option(name) for name in analysis.options]),
    ):
        if names:
            yield f"{title}: {', '.join(names)}"
    if analysis.constants or analysis.optional_constants:
        yield "each constant is a quantity, or {value: 50 mm, u: 0.1 mm} with its uncertainty"


def _with_units(names: Iterable[str], units: Mapping[str, str]) -> list[str]:
    return [f"{name} ({units[name]})" if name in units else name for name in names]


def _option(name: str) -> str:
    return "--group-by recording" if name == "by_recording" else f"--{name}"
