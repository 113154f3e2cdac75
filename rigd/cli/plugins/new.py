"""``rigd new``: writes the package of a plug-in, which passes its own tests, or a rig's folder."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

HELP = "write a rig of your own with its simulated sibling, or a driver, plant, analysis, law"
EXAMPLES = """\
examples:
  rigd new rig pin-on-disk                   asks for a few numbers; a folder that runs at once
  rigd new rig my-rig --from rig.yaml        from a description; docs/new_rig.md

  rigd new driver acme-scale --kind slow     a device that is asked now and then
  rigd new driver acme-servo --kind fast     one that is exchanged with in every cycle
  pip install -e 'acme-scale[test]' && pytest acme-scale && rigd drivers acme-scale

  rigd new plant acme-sled                   physics, simulated devices, a rig and a procedure
  rigd new analysis acme-coast               recordings to parameters with a report
  rigd new friction-law acme-rubber          slip in, friction out, for `rigd identify --law`

  The new package passes check_driver(), check_plant(), check_analysis() or check_friction_law() at
  once; docs/drivers.md, docs/plants.md, docs/analyses.md and docs/friction_laws.md show how to
  adapt it.
"""

#: Kinds of drivers.
KINDS: Final = ("fast", "slow")
#: Kinds of drivers that had a template, each with what to do instead.
RETIRED: Final = {
    "block": "write a BlockDriver as rigd_drivers.cards.ni_daq does",
    "serial": "take `--kind slow`, with rigd.sdk.port as rigd_drivers.instruments.scale does",
    "scpi": "`driver: line-outputs` or `driver: scpi` needs no code; else take `--kind fast`",
}
_ARTICLES: Final = {"driver": "a", "plant": "a", "analysis": "an", "friction-law": "a"}
#: Kinds of plug-ins, each with the name of its entry points.
_PLURALS: Final = {
    "driver": "drivers",
    "plant": "plants",
    "analysis": "analyses",
    "friction-law": "friction_laws",
}
#: The command that lists the installed plug-ins of this kind, or uses one by its name.
_LISTS: Final = {
    "driver": "drivers",
    "plant": "drivers",
    "analysis": "analyses",
    "friction-law": "identify FILE --law",
}
_TEMPLATES: Final = Path(__file__).parents[1] / "templates"
#: Longest name, in characters: folders, modules and classes are named by it.
_MAX_NAME: Final = 40
#: Additional keys of the rig file in the README of a driver with a setpoint.
_LIMITS: Final = """
    limits:
      speed: {low: -1 m/s, high: 1 m/s, rate: 5 m/s^2}"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("what", choices=("rig", *_PLURALS), help="kind of plug-in, or rig")
    parser.add_argument(
        "name", metavar="NAME", help="name of the package or rig, such as acme-scale"
    )
    parser.add_argument(
        "--kind", choices=KINDS, type=_kind, help=f"kind of driver (default: {KINDS[0]})"
    )
    parser.add_argument(
        "--from", dest="source", type=Path, metavar="FILE",
        help="description of the rig (default: questions at the terminal, or lines of standard "
        "input; without either, a pin-on-disk)",
    )  # fmt: skip
    parser.add_argument(
        "--folder", type=Path, default=Path(), metavar="DIR",
        help="folder in which to make the folder NAME (default: here)",
    )  # fmt: skip


def _kind(word: str) -> str:
    """Return ``word``; name what took the place of a kind that is no more."""
    if word in RETIRED:
        raise argparse.ArgumentTypeError(
            f"there is no template of kind {word} any more: {RETIRED[word]} "
            "(docs/drivers.md, `Which kind`)"
        )
    return word


def execute(args: argparse.Namespace) -> int:
    """Write the package and print the next commands."""
    from rigd.model.errors import ConfigError

    if not args.folder.is_dir():
        raise ConfigError(f"folder {args.folder} does not exist", hint="create it first")
    if args.what != "driver" and args.kind is not None:
        raise ConfigError("--kind is for drivers only", hint="remove it")
    if args.what != "rig" and args.source is not None:
        raise ConfigError("--from is for rigs only", hint="remove it")
    if args.what == "rig":
        check_shape(args.name)
    else:
        check_name(args.name, args.what)
    target: Path = args.folder / args.name
    if target.exists() or target.is_symlink():
        raise ConfigError(f"{target} exists already", hint="choose another name or --folder")
    if args.what == "rig":
        return _new_rig(args.name, args.source, target)
    kind = (args.kind or KINDS[0]) if args.what == "driver" else args.what
    files = rendered(args.name, kind)
    try:
        for name, text in files.items():
            path = target / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, "utf-8")
    except OSError as error:
        raise ConfigError(f"{error.filename} cannot be written: {error.strerror}") from error
    made = f"a {kind} driver" if args.what == "driver" else f"{_ARTICLES[kind]} {kind}"
    then = f"rigd {_LISTS[args.what]} {args.name}"
    if args.what == "plant":
        then = f"rigd run {target / 'push.yaml'} --rig {target / 'rig.yaml'}"
    print(
        f"wrote {target}, {made} whose tests pass:\n  pip install -e '{target}[test]'\n  "
        f"pytest {target}\n  {then}\nto make it yours, read {target / 'README.md'}"
    )
    return 0


def _new_rig(name: str, source: Path | None, target: Path) -> int:
    """Write the folder of a rig and print the next commands."""
    from rigd.cli.plugins.new_rig.folder import DESCRIPTION, write_rig
    from rigd.cli.plugins.new_rig.questions import Asker, described
    from rigd.config.document import read_document
    from rigd.model.errors import ConfigError

    asker = Asker()
    if source is None:
        text, named = described(name, asker.ask), Path(DESCRIPTION)
    else:
        text, named = read_document(source).text, source
    try:
        written = write_rig(name, text, named, target)
    except ConfigError as error:
        if source is not None:
            raise
        said = "; ".join(item.message for item in (error, *error.others))
        raise ConfigError(  # no file has the line that it names
            f"the answers make no rig: {said}",
            hint=f"nothing is written: {error.hint or 'give other answers'}",
        ) from error
    if asker.defaults:
        print(asker.defaults, file=sys.stderr)
    git = ", under version control (nothing is committed yet)" if written.under_git else ""
    wire = "  rigd sim wire.yaml   serves its devices, for `--rig wire.yaml` in another terminal\n"
    if written.no_wire:
        wire = f"no wire.yaml, for the real drivers on simulated devices: {written.no_wire}\n"
    print(
        f"wrote {target}{git}:\n  cd {target}\n  rigd run procedures/first.yaml --rig sim.yaml\n"
        f"  rigd run procedures/first.yaml --rig real.yaml --dry-run\n{wire}"
        f"before the real rig moves, and for CI, read {target / 'README.md'}"
    )
    return 0


def check_shape(name: str) -> None:
    """Refuse what is no name of a folder, package and rig.

    Raises:
        ConfigError: the name is refused; the message gives the reason.
    """
    import re

    from rigd.model.errors import ConfigError

    shape = r"[a-z][a-z0-9]*(-[a-z0-9]+)*"
    if not re.fullmatch(shape, name) or len(name) > _MAX_NAME:
        raise ConfigError(
            f"{name!r} is not a valid name",
            hint="use lower case letters and digits, words joined by a dash, at most "
            f"{_MAX_NAME} characters, such as acme-scale",
        )


def check_name(name: str, what: str = "driver") -> None:
    """Refuse names that cannot be a package or would hide another one; ``what`` is the kind.

    Raises:
        ConfigError: the name is refused; the message gives the reason.
    """
    import importlib.util
    import keyword
    from importlib.metadata import entry_points

    from rigd.model.errors import ConfigError

    module = module_name(name)
    check_shape(name)
    if keyword.iskeyword(module):
        raise ConfigError(f"{name!r} is a keyword of Python", hint=f"such as {name}-{what}")
    if entry_points(group=f"rigd.{_PLURALS[what]}", name=name):
        raise ConfigError(
            f"{_ARTICLES[what]} {what} {name!r} is installed",
            hint=f"`rigd {_LISTS[what]}` lists the names that are in use",
        )
    spec = importlib.util.find_spec(module)
    if module == "tests" or (
        spec is not None and spec.origin
    ):  # a folder without __init__.py has no origin
        raise ConfigError(
            f"package {module!r} exists already, and would be hidden",
            hint=f"choose another name, such as {name}-{what}",
        )


def module_name(name: str) -> str:
    """Return the import name of package ``name``."""
    return name.replace("-", "_")


def rendered(name: str, kind: str) -> Mapping[str, str]:
    """Return the files of a package by path, below its folder.

    ``kind`` is one of :data:`KINDS` of drivers, ``plant``, ``analysis`` or ``friction-law``.
    """
    if kind not in KINDS:
        return filled(_TEMPLATES / kind, name, kind)
    drivers = _TEMPLATES / "driver"
    return {**filled(drivers / "common", name, kind), **filled(drivers / kind, name, kind)}


def filled(folder: Path, name: str, kind: str) -> Mapping[str, str]:
    """Return the files of the templates in ``folder`` by path, for package ``name``.

    Templates have words in double braces, as in Jinja, and use no other feature of Jinja.
    """
    import re

    module = module_name(name)
    words = {
        "name": name,
        "module": module,
        "cls": "".join(word.capitalize() for word in name.split("-")),
        "kind": kind,
        "limits": _LIMITS if kind == "fast" else "",
    }
    files = {}
    for path in sorted(folder.rglob("*.jinja")):
        path_out = path.relative_to(folder).with_suffix("").as_posix()
        path_out = path_out.replace("MODULE", module).replace("NAME", name)
        files[path_out] = re.sub(
            r"\{\{ (\w+) \}\}", lambda found: words[found[1]], path.read_text("utf-8")
        )
    return files
