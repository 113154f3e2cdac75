"""Writes the chosen tests as a procedure: its base with other trials."""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from rigd.analysis import ConfigError
from rigd_analyses.lugre.design.shapes import LONGEST_S, Kind, Shape

CURRENT = "${current}"
_HEAD = re.compile(r"\A(?:#.*\n)+")  #: of the base: it is about that file
#: The beginning of a parameter, a step or a block that no empty line sets off.
_BLOCK = re.compile(r"(?<=[^\n:])\n(  \w+:(?=\n)|    - step:|  after:(?=\n)|\w+:(?=\n))")
#: A quantity that the end of a line parts from its unit, and a space before the end of a line.
_PARTED = re.compile(r" (-?[\d.e-]+) *\n( +)(\w+)(?=[,\]])")
_SPACE = re.compile(r" +\n")


def drive_step(base: Mapping[str, Any], setpoint: str) -> int:
    """Return which step of the base's trials gives the motor its current.

    Raises:
        ConfigError: there is none.
    """
    for index, step in enumerate(base["trial"]["steps"]):
        if step.get("set", {}).get(setpoint) == CURRENT:
            return index
    raise ConfigError(
        f"the base procedure has no step that sets {setpoint} to {CURRENT}",
        hint="give a procedure such as constant_current with --base",
    )


def written(
    base: str, name: str, title: str, doc: str, shapes: Sequence[Shape],
    signals: Mapping[str, str], groups: Sequence[str],
) -> str:  # fmt: skip
    """Return the text of the procedure: ``base`` with ``shapes`` as its trials.

    ``signals`` are those of the base's plan of identification. ``groups`` are what it is designed
    for, such as floors: a single one becomes the default.

    Raises:
        ConfigError: the base has no step that drives.
    """
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 100
    yaml.indent(mapping=2, sequence=4, offset=2)
    data = yaml.load(_HEAD.sub("", base))
    setpoint, position = signals["motor_current"], signals["carriage_position"]
    index = drive_step(data, setpoint)
    data["procedure"], data["title"], data["doc"] = name, title, doc
    steps = data["trial"]["steps"]
    steps[index : index + 1] = list(_steps(setpoint, position, {shape.kind for shape in shapes}))
    unused = set(data["parameters"]) - _used(data, yaml) - set(data["identify"]["group_by"])
    for parameter in unused:
        del data["parameters"][parameter]
    if len(groups) == len(by := data["identify"]["group_by"]) == 1:
        grouped = data["parameters"][by[0]]
        if groups[0] in grouped.get("choices", ()):
            grouped["default"] = groups[0]
    data["parameters"] |= _parameters(shapes)
    columns = _columns(sorted(shapes))
    data["sweep"] = CommentedMap(
        zip=CommentedMap((key, _flow(row)) for key, row in columns.items())
    )
    out = io.StringIO()
    yaml.dump(data, out)
    text = _SPACE.sub("\n", _PARTED.sub(r"\n\2\1 \3", out.getvalue()))
    return _BLOCK.sub(r"\n\n\1", text)


def _used(data: Mapping[str, Any], yaml: YAML) -> set[str]:
    """Return the parameters that something besides the sweep uses."""
    out = io.StringIO()
    yaml.dump({key: value for key, value in data.items() if key != "sweep"}, out)
    tables = {table["by"] for table in data.get("tables", {}).values()}
    return {*re.findall(r"\$\{(\w+)\}", out.getvalue()), *tables} - {"current"}


def _steps(setpoint: str, position: str, kinds: Collection[Kind]) -> Iterator[CommentedMap]:
    """Yield the steps of shapes of these ``kinds``; a trial plays those of its own."""
    there = f"{position} > ${{stop_at}}"

    def step(name: str, kind: Kind, value: object, until: str, longest: str) -> CommentedMap:
        return CommentedMap(
            step=name, when=_flow({"shape": kind.value}), set=CommentedMap({setpoint: value}),
            until=until, timeout=longest, on_timeout="next",
        )  # fmt: skip

    ramp = {"from": CURRENT, "to": "${second}", "over": "${lasting}"}
    square = {"amplitude": CURRENT, "frequency": "${frequency}"}
    change = f"{position} > ${{change_at}}"
    if Kind.HOLD in kinds:
        yield step("drive", Kind.HOLD, CURRENT, there, "${lasting}")
    if Kind.CHANGE in kinds:
        yield step("drive to the change", Kind.CHANGE, CURRENT, change, f"{LONGEST_S:g} s")
        yield step("drive on", Kind.CHANGE, "${second}", there, "${lasting}")
    if Kind.RAMP in kinds:
        yield step("drive a ramp", Kind.RAMP, CommentedMap(ramp=_flow(ramp)), there, "${lasting}")
    if Kind.SWING in kinds:
        yield step("swing", Kind.SWING, CommentedMap(square=_flow(square)), there, "${lasting}")


def _parameters(shapes: Sequence[Shape]) -> CommentedMap:
    most = max(abs(value) for shape in shapes for value in (shape.current_a, shape.second_a))
    far = max(2.0, *(shape.stop_at_m for shape in shapes))

    def entry(doc: str, unit: str, low: str, high: str) -> CommentedMap:
        return CommentedMap(doc=doc, unit=unit, min=low, max=high)

    kinds = _flow([kind.value for kind in Kind])
    return CommentedMap(
        shape=CommentedMap(doc="Shape of the current over a trial", choices=kinds),
        current=entry("First current; of a swing its amplitude", "A", "0 A", f"{most:g} A"),
        second=entry(
            "Second current (change), last current (ramp)", "A", f"-{most:g} A", f"{most:g} A"
        ),
        change_at=entry("Where the current changes (change)", "m", "0 m", f"{far:g} m"),
        frequency=entry("Swings per second (swing)", "Hz", "0.1 Hz", "10 Hz"),
        lasting=entry("Longest time of the last part of the drive", "s", "0.1 s", "30 s"),
        stop_at=entry("Where the drive ends", "m", "0 m", f"{far:g} m"),
    )


def _columns(shapes: Sequence[Shape]) -> dict[str, list[str]]:
    return {
        "shape": [shape.kind.value for shape in shapes],
        "current": [f"{shape.current_a:g} A" for shape in shapes],
        "second": [f"{shape.second_a:g} A" for shape in shapes],
        "change_at": [f"{shape.change_at_m:g} m" for shape in shapes],
        "frequency": [f"{shape.frequency_hz:g} Hz" for shape in shapes],
        "lasting": [f"{shape.lasting_s:g} s" for shape in shapes],
        "stop_at": [f"{shape.stop_at_m:g} m" for shape in shapes],
    }


def _flow(value: Mapping[str, Any] | Sequence[Any]) -> CommentedMap | CommentedSeq:
    found: CommentedMap | CommentedSeq
    if isinstance(value, Mapping):
        found = CommentedMap((key, _quoted(item)) for key, item in value.items())
    else:
        found = CommentedSeq(_quoted(item) for item in value)
    found.fa.set_flow_style()
    return found


def _quoted(value: object) -> object:
    """Return ``value`` as YAML within braces needs it."""
    text = str(value)
    return DoubleQuotedScalarString(text) if "${" in text else value
