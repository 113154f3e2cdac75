"""``rigd new``: writes a package for a plug-in that installs and passes its own tests."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Final

HELP = "make a package of your own: a driver, a plant or an analysis, with tests"
EXAMPLES = """\
examples:
  rigd new driver acme-scale --kind slow     a device that is asked now and then
  rigd new driver acme-servo --kind fast     one that is exchanged with in every cycle
  rigd new driver acme-daq --kind block      a card whose library hands over many rows at once
  pip install -e 'acme-scale[test]' && pytest acme-scale && rigd drivers acme-scale

  rigd new plant acme-sled                   physics, simulated devices, a rig and a procedure
  rigd new analysis acme-coast               recordings to parameters with a report

  What is made passes check_driver(), check_plant() or check_analysis() as it is; docs/drivers.md,
  docs/plants.md and docs/analyses.md show how to make it yours.
"""

KINDS: Final = ("fast", "slow", "block")
_ARTICLES: Final = {"driver": "a", "plant": "a", "analysis": "an"}
_PLURALS: Final = {"driver": "drivers", "plant": "plants", "analysis": "analyses"}
#: The command that lists what is installed.
_LISTS: Final = {"driver": "drivers", "plant": "drivers", "analysis": "analyses"}
_TEMPLATES: Final = Path(__file__).parent / "templates"
#: Longest name, in characters: it becomes names of folders, modules and classes.
_MAX_NAME: Final = 40


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("what", choices=tuple(_PLURALS), help="what to make")
    parser.add_argument("name", metavar="NAME", help="name in files, such as acme-scale")
    parser.add_argument("--kind", choices=KINDS, help=f"kind of driver (default: {KINDS[0]})")
    parser.add_argument(
        "--folder", type=Path, default=Path(), metavar="DIR",
        help="where to make the folder NAME (default: here)",
    )  # fmt: skip


def execute(args: argparse.Namespace) -> int:
    """Make the package and say what to do with it."""
    from rigd.model.errors import ConfigError

    if not args.folder.is_dir():
        raise ConfigError(f"there is no folder {args.folder}", hint="make it first")
    if args.what != "driver" and args.kind is not None:
        raise ConfigError("--kind is of drivers only", hint="leave it out")
    check_name(args.name, args.what)
    target: Path = args.folder / args.name
    if target.exists() or target.is_symlink():
        raise ConfigError(f"{target} is there already", hint="choose another name or --folder")
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
        f"made {target}, {made} that passes its tests as it is:\n"
        f"  pip install -e '{target}[test]'\n"
        f"  pytest {target}\n"
        f"  {then}\n"
        f"now make it yours: {target / 'README.md'} says how"
    )
    return 0


def check_name(name: str, what: str = "driver") -> None:
    """Refuse names that cannot be a package, or would hide another; ``what`` is to be made.

    Raises:
        ConfigError: the name will not do; says why.

    """
    import importlib.util
    import keyword
    import re
    from importlib.metadata import entry_points

    from rigd.model.errors import ConfigError

    module = module_name(name)
    shape = r"[a-z][a-z0-9]*(-[a-z0-9]+)*"
    if not re.fullmatch(shape, name) or len(name) > _MAX_NAME:
        raise ConfigError(
            f"{name!r} will not do as a name",
            hint=f"lower case letters and digits, words joined by a dash, at most {_MAX_NAME} "
            "characters, such as acme-scale",
        )
    if keyword.iskeyword(module):
        raise ConfigError(f"{name!r} is a word of Python", hint=f"such as {name}-{what}")
    if entry_points(group=f"rigd.{_PLURALS[what]}", name=name):
        raise ConfigError(
            f"{_ARTICLES[what]} {what} {name!r} is installed",
            hint=f"`rigd {_LISTS[what]}` lists the names that are taken",
        )
    spec = importlib.util.find_spec(module)
    if module == "tests" or (spec is not None and spec.origin):  # a mere folder has no origin
        raise ConfigError(
            f"a package {module!r} exists already, and would be hidden",
            hint=f"choose another name, such as {name}-{what}",
        )


def module_name(name: str) -> str:
    """Return the import name of package ``name``."""
    return name.replace("-", "_")


def rendered(name: str, kind: str) -> Mapping[str, str]:
    """Return the files of a package by path, below its folder.

    ``kind`` is one of :data:`KINDS` of drivers, ``plant`` or ``analysis``.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True)
    module = module_name(name)
    words = {
        "name": name,
        "module": module,
        "cls": "".join(word.capitalize() for word in name.split("-")),
        "kind": kind,
        "port": 7000,
    }
    files = {}
    drivers = _TEMPLATES / "driver"
    folders = (drivers / "common", drivers / kind) if kind in KINDS else (_TEMPLATES / kind,)
    for folder in folders:
        for path in sorted(folder.rglob("*.jinja")):
            where = path.relative_to(folder).with_suffix("").as_posix()
            template = environment.from_string(path.read_text("utf-8"))
            where = where.replace("MODULE", module).replace("NAME", name)
            files[where] = template.render(words)
    return files
