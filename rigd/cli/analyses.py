"""``rigd analyses``: what is installed, and what each needs of a procedure."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

HELP = "list the analyses that are installed, and what each needs of a procedure"
EXAMPLES = """\
examples:
  rigd analyses                       names, packages and what each is
  rigd analyses lugre                 its signals, constants, parameters and options
  rigd analyses lugre --json

  `identify: {model: NAME}` in a procedure names one. Any installed package may bring some: see
  docs/analyses.md and `rigd new analysis`.
  Exit code 2: there is no such name, or what was asked for cannot be loaded.
"""


@dataclass(frozen=True)
class InstalledAnalysis:
    """One entry point as it was found; ``broken`` says why it cannot be used."""

    name: str
    package: str
    version: str
    title: str = ""
    doc: str = ""
    broken: str = ""
    signals: Mapping[str, str] = field(default_factory=dict)  #: with their units
    optional_signals: Mapping[str, str] = field(default_factory=dict)
    constants: tuple[str, ...] = ()
    optional_constants: tuple[str, ...] = ()
    trial_parameters: tuple[str, ...] = ()
    references: tuple[str, ...] = ()
    calibrated: tuple[str, ...] = ()
    measures: tuple[str, ...] = ()
    options: tuple[str, ...] = ()


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="show this one in full")
    parser.add_argument("--json", action="store_true", help="print everything as JSON")


def execute(args: argparse.Namespace) -> int:
    """List what is installed; what is broken never hides the rest."""
    from importlib.metadata import entry_points

    from rigd.config.problems import suggest
    from rigd.config.registry import ANALYSES
    from rigd.model.errors import ConfigError, Exit

    points = sorted(entry_points(group=ANALYSES), key=lambda point: point.name)
    wanted = [point for point in points if args.name in (None, point.name)]
    if not wanted:
        raise ConfigError(
            f"there is no analysis {args.name!r}",
            hint=suggest(args.name, {point.name for point in points}),
        )
    found = [_look_at(point) for point in wanted]
    if args.json:
        print(json.dumps([asdict(item) for item in found], indent=2, ensure_ascii=False))
    elif args.name is None:
        _print_list(found)
    else:
        for item in found:
            print("\n".join(_in_full(item)))
    broken = args.name is not None and any(item.broken for item in found)
    return int(Exit.BAD_INPUT if broken else Exit.OK)


def _look_at(point: EntryPoint) -> InstalledAnalysis:
    """Return what stands behind an entry point; what its loading raises is reported as broken."""
    from rigd.analysis import Analysis
    from rigd.cli.inventory import introduction

    package, version = (point.dist.name, point.dist.version) if point.dist else ("?", "?")
    try:
        loaded = point.load()
        title, doc = introduction(loaded, Analysis)
    except (Exception, SystemExit) as error:  # noqa: BLE001  # one broken package hides no other
        reason = f"{type(error).__name__}: {error}"
        return InstalledAnalysis(point.name, package, version, broken=reason)
    needs = loaded.needs
    return InstalledAnalysis(
        point.name,
        package,
        version,
        title,
        doc,
        signals=needs.signals,
        optional_signals=needs.optional_signals,
        constants=needs.constants,
        optional_constants=needs.optional_constants,
        trial_parameters=needs.trial_parameters,
        references=needs.references,
        calibrated=needs.calibrated,
        measures=loaded.measures,
        options=loaded.options,
    )


def _print_list(found: list[InstalledAnalysis]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.screen import print_table

    # Piped, a line is a line: nothing folds.
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 400)
    table = Table(box=None, pad_edge=False, show_header=False)
    for _ in range(3):
        table.add_column(overflow="fold")
    for item in found:
        text = f"[red]broken: {escape(item.broken)}[/]" if item.broken else escape(item.title)
        table.add_row(item.name, f"{item.package} {item.version}", text)
    print_table(console, table)


def _in_full(analysis: InstalledAnalysis) -> Iterator[str]:
    yield f"{analysis.name}  analysis of {analysis.package} {analysis.version}"
    if analysis.broken:
        yield f"  broken: {analysis.broken}"
        return
    yield from (f"  {line}".rstrip() for line in analysis.doc.splitlines())
    for title, names in (
        ("signals", [f"{name} ({unit})" for name, unit in analysis.signals.items()]),
        ("signals it may have", [f"{k} ({unit})" for k, unit in analysis.optional_signals.items()]),
        ("constants", analysis.constants),
        ("constants it may have", analysis.optional_constants),
        ("parameters of trials", analysis.trial_parameters),
        ("calibrated values it rests on", analysis.calibrated),
        ("calibrated values it measures", analysis.measures),
        ("published values it compares with", analysis.references),
        ("options of `rigd identify`", [_option(name) for name in analysis.options]),
    ):
        if names:
            yield f"{title}: {', '.join(names)}"


def _option(name: str) -> str:
    return "--group-by recording" if name == "by_recording" else f"--{name}"
