"""Writes the folder of a new rig, and tries what it has written before anybody else does."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, Final, NamedTuple

from rigd.cli.plugins.new_rig.at_wire import WIRE_FILE, NotServed, at_wire
from rigd.cli.plugins.new_rig.description import (
    PLANT_FILE,
    REAL_FILE,
    SIM_FILE,
    FirstSource,
    Twins,
    read_twins,
)
from rigd.cli.plugins.new_rig.yaml_text import yaml_text
from rigd.config.document import Document, parse_document
from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.model.errors import ConfigError, Place
from rigd.model.units import format_quantity

_TEMPLATES: Final = Path(__file__).parents[2] / "templates" / "rig"
DESCRIPTION: Final = "rig.yaml"
FIRST: Final = "procedures/first.yaml"
_HEADS: Final = {
    PLANT_FILE: "# The mechanism that simulates {name}: docs/mechanism.md.\n",
    REAL_FILE: "# The real rig {name}. Compare every number with its machine first.\n",
    WIRE_FILE: "# {name} with simulated devices at the wire: `rigd sim wire.yaml` serves them.\n",
    SIM_FILE: "# {name} simulated: sibling of real.yaml, with its names, limits, interlocks.\n",
}


class Written(NamedTuple):
    """What stands in the folder beside the rig."""

    under_git: bool
    #: Why there is no rig at the wire; "" if there is one.
    no_wire: str


def write_rig(name: str, text: str, source: Path, target: Path) -> Written:
    """Write the folder ``target`` of the rig that ``text`` describes.

    ``source`` is the name of the description in messages. Nothing is left if it is wrong.

    Raises:
        ConfigError: the description is wrong; every problem with its place in it.
    """
    document = parse_document(text, source)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=target.parent))
    except OSError as error:
        raise ConfigError(f"{target} cannot be written: {error.strerror}") from error
    try:
        no_wire = _write(name, document, folder)
        folder.chmod(0o755)
        folder.rename(target)
    except OSError as error:
        raise ConfigError(f"{target} cannot be written: {error.strerror}") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return Written(_versioned(target), no_wire)


def _write(name: str, document: Document, folder: Path) -> str:
    """Write all files; return why there is no rig at the wire, "" if there is one."""
    mechanism = document.get(("mechanism",))
    if isinstance(mechanism, Mapping):
        _put(folder, PLANT_FILE, _headed(PLANT_FILE, name, mechanism))
    twins = read_twins(document, name, folder)
    _put(folder, DESCRIPTION, document.text)
    _put(folder, REAL_FILE, _headed(REAL_FILE, name, twins.real))
    _put(folder, SIM_FILE, _headed(SIM_FILE, name, twins.sim))
    devices: Any = document.get(("devices",))
    no_wire = ""
    try:
        wire = at_wire(name, twins.real, devices)
    except NotServed as reason:
        no_wire = str(reason)
    else:
        _put(folder, WIRE_FILE, _headed(WIRE_FILE, name, wire))
        load_rig(folder / WIRE_FILE)
    words = {
        "name": name,
        "title": twins.real["title"],
        "version": metadata.version("rigd"),
        **_first(twins, document),
    }
    for path in sorted(_TEMPLATES.rglob("*.jinja")):
        inside = path.relative_to(_TEMPLATES).with_suffix("").as_posix()
        if inside != "pin_on_disk.yaml":
            _put(folder, inside.replace("DOT", "."), _filled(path.read_text("utf-8"), words))
    (folder / "try").chmod(0o755)
    _check_first(folder, document)
    return no_wire


def _put(folder: Path, name: str, text: str) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")


def _headed(file: str, name: str, data: Mapping[str, object]) -> str:
    return _HEADS[file].format(name=name) + "\n" + yaml_text(data).lstrip("\n")


def _filled(text: str, words: Mapping[str, str]) -> str:
    return re.sub(r"\{\{ (\w+) \}\}", lambda found: words[found[1]], text)


def _first(twins: Twins, document: Document) -> dict[str, str]:
    """Return what the first procedure sets."""
    first = twins.first or _chosen(twins.real_rig, document)
    unit = _unit(first, twins.real_rig, document)
    return {
        "setpoint": first.setpoint,
        "unit": unit,
        "values": ", ".join(first.values),
        "seconds": first.seconds,
        "measure": _measured(first),
        "rest": f"0 {unit}".removesuffix(" 1"),
    }


def _measured(first: FirstSource) -> str:
    """Return the part of the procedure with its measures; repeated, they have an interval."""
    if not first.measure:
        return ""
    judged = {"accept": first.accept} if first.accept else {}
    return f"\nrepeats: 3\n{yaml_text({'measure': first.measure, **judged})}"


def _chosen(rig: RigConfig, document: Document) -> FirstSource:
    """Return a quarter and a half of the range of the first setpoint, held for 5 s."""
    for device in rig.devices.values():
        for setpoint in device.declaration.setpoints:
            limit = device.limits[setpoint.name]
            most = limit.high if limit.high > 0.0 else limit.low
            values = [format_quantity(share * most, setpoint.unit) for share in (0.25, 0.5)]
            return FirstSource.model_validate(
                {"setpoint": f"{device.name}.{setpoint.name}", "values": values, "for": "5 s"}
            )
    raise ConfigError(
        "no device takes a setpoint: there is nothing for a procedure to do",
        place=document.place(("devices",)), hint="give the device that moves the rig",
    )  # fmt: skip


def _unit(first: FirstSource, rig: RigConfig, document: Document) -> str:
    for device in rig.devices.values():
        for setpoint in device.declaration.setpoints:
            if first.setpoint == f"{device.name}.{setpoint.name}":
                return setpoint.unit
    raise ConfigError(
        f"no setpoint {first.setpoint!r}", place=document.place(("first", "setpoint"))
    )


def _check_first(folder: Path, document: Document) -> None:
    """Compile the first procedure for both rigs.

    Raises:
        ConfigError: it does not fit, because of what the description states under ``first``.
    """
    from rigd.procedure.compile import compile_procedure
    from rigd.procedure.loader import load_procedure

    for file in (REAL_FILE, SIM_FILE):
        try:
            compile_procedure(load_procedure(folder / FIRST), load_rig(folder / file), {})
        except ConfigError as error:
            place: Place = document.place(("first",))
            raise ConfigError(
                f"the first procedure cannot be played on {file}: {error.message}", place=place
            ) from error


def _versioned(target: Path) -> bool:
    """Put the folder under version control, if git is there and it is in no repository yet."""
    git = shutil.which("git")
    if git is None:
        return False

    def run(*command: str) -> bool:
        done = subprocess.run([git, "-C", str(target), *command], capture_output=True, check=False)
        return done.returncode == 0

    if run("rev-parse", "--is-inside-work-tree"):
        return False
    return run("init", "--quiet") and run("add", "--all")
