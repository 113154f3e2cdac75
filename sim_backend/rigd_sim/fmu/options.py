"""Reads what a rig file states of an FMU: which file it is, and with which values it begins."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Final

from annotated_types import Gt, Le
from pydantic import Field, ValidationInfo, field_validator, model_validator

from rigd.sdk import DeviceError, Documented, In, WrongEntries
from rigd_sim.fmu.description import FmuFile, Variable, read_fmu
from rigd_sim.fmu.process import FmuProcess, Start

#: A communication step of an FMU with a fixed one may differ by so much of it: its text is rounded.
_NEAR: Final = 1e-9


class UnitOptions(Documented):
    """Which FMU, and with which values it begins."""

    file: str
    """The FMU of FMI 2 or 3 for co-simulation: a path, from the folder of the rig file on."""
    start: dict[str, str] = Field(default_factory=dict)
    """Values of parameters and inputs at the start, each in a unit: `{mass: 2 kg}`."""
    deadline: Annotated[float, In("s"), Gt(0), Le(600)] = 5.0
    """Longest time for one step, of the wall."""
    set_up: Annotated[float, In("s"), Gt(0), Le(600)] = 60.0
    """Longest time for loading the FMU and initialising it, of the wall."""

    @field_validator("file")
    @classmethod
    def _file_is_an_fmu(cls, name: str, info: ValidationInfo) -> str:
        """Resolve the file; ``folder`` in the validation context is the folder of the rig file."""
        path = (Path((info.context or {}).get("folder") or Path.cwd()) / name).resolve()
        if not path.is_file():
            raise ValueError(f"no file {path}")
        read_fmu(path)
        return str(path)

    @model_validator(mode="after")
    def _it_can_be_set_up(self) -> UnitOptions:
        """Set the FMU up once, in a process of its own, before anything moves."""
        start = self.start_values()
        try:
            _tried(self.file, self.fmu.sha256, start, self.set_up, self.deadline)
        except DeviceError as error:
            raise WrongEntries([(("file",), str(error))]) from error
        return self

    @property
    def fmu(self) -> FmuFile:
        """The file, read."""
        return read_fmu(Path(self.file))

    def start_values(self) -> tuple[Start, ...]:
        """Return the start values in the FMU's own units.

        Raises:
            WrongEntries: the FMU has no such variable, it takes none, or another value.
        """
        values: list[Start] = []
        problems: list[tuple[tuple[str | int, ...], str]] = []
        for name, text in self.start.items():
            try:
                variable = find(self.fmu, name, settable=True)
                values.append((name, start_value(variable, text)))
            except ValueError as error:
                problems.append((("start", name), str(error)))
        if problems:
            raise WrongEntries(problems)
        return tuple(values)

    def explained(self, **more: object) -> Mapping[str, str]:
        """Return what the FMU is, with ``more`` about it, and its model description, by name."""
        fmu = self.fmu
        facts = {
            "file": fmu.path.name,
            "sha256": fmu.sha256,
            "fmi": fmu.version,
            "model": fmu.model,
            "guid": fmu.token,
            "tool": fmu.tool,
            "made": fmu.made,
            "start": {name: _with_unit(fmu, name, value) for name, value in self.start_values()},
            **more,
        }
        lines = "".join(
            f"{key}: {json.dumps(value, ensure_ascii=False)}\n" for key, value in facts.items()
        )
        return {
            f"{fmu.path.name}.yaml": lines,
            f"{fmu.path.name}.xml": fmu.xml,
        }


def misfit(fmu: FmuFile, step_ns: int) -> str:
    """Return why an FMU with a fixed internal step cannot step by ``step_ns``, or ""."""
    fixed_s = fmu.fixed_step_s
    if fixed_s is None or fixed_s <= 0:
        return ""
    parts = step_ns * 1e-9 / fixed_s
    if round(parts) >= 1 and abs(parts - round(parts)) <= _NEAR * parts:
        return ""
    return (
        f"{fmu.path.name} steps by {fixed_s:g} s: a communication step of {step_ns * 1e-9:g} s is "
        "no multiple of it"
    )


def find(fmu: FmuFile, name: str, *, settable: bool = False) -> Variable:
    """Return the variable ``name``.

    Raises:
        ValueError: there is none, it is an array, or it takes no value at the start.
    """
    from difflib import get_close_matches

    variable = fmu.variables.get(name)
    if variable is None:
        near = get_close_matches(name, fmu.variables, n=1, cutoff=0.5)
        known = ", ".join(list(fmu.variables)[:12]) + (", ..." if len(fmu.variables) > 12 else "")
        hint = f"did you mean {near[0]!r}?" if near else f"it has {known}"
        raise ValueError(f"{fmu.path.name} has no variable {name!r}; {hint}")
    if variable.array:
        raise ValueError(f"{name!r} is an array; rigd takes single numbers")
    if settable and (not variable.settable or variable.causality == "structuralParameter"):
        raise ValueError(
            f"{name!r} takes no value: it is a {variable.variability} {variable.causality}, which "
            "the FMU itself computes"
        )
    return variable


def start_value(variable: Variable, text: str) -> float | int | bool | str:
    """Return the text of a start value as the FMU takes it.

    Raises:
        ValueError: it is of another type or unit, or out of the variable's range.
    """
    name, kind = variable.name, variable.kind
    if kind == "String":
        return text
    if kind == "Boolean":
        if text not in ("true", "false"):
            raise ValueError(f"{name!r} is true or false, found {text!r}")
        return text == "true"
    if text in variable.items:
        return variable.items[text]
    number = _real(variable, text) if kind in ("Real", "Float64", "Float32") else _whole(name, text)
    low = -math.inf if variable.low is None else variable.low
    high = math.inf if variable.high is None else variable.high
    if not low <= number <= high:
        unit = f" {variable.unit_name}" if variable.unit_name else ""
        raise ValueError(f"{name!r} is {text}; the FMU takes {low:g} to {high:g}{unit}")
    return number


def _real(variable: Variable, text: str) -> float:
    if variable.unit is not None:
        return variable.unit.read(text)
    try:
        return float(text)
    except ValueError:
        has = f"the unit {variable.unit_name!r}, which it does not define" if (
            variable.unit_name
        ) else "no unit"  # fmt: skip
        raise ValueError(
            f"{text!r}: the FMU gives {variable.name!r} {has}; write the bare number that it takes"
        ) from None


def _whole(name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"{name!r} is a whole number, found {text!r}") from None


def _with_unit(fmu: FmuFile, name: str, value: Any) -> str:
    return f"{value} {fmu.variables[name].unit_name}".strip()


@lru_cache(maxsize=16)
def _tried(
    file: str, sha256: str, start: tuple[Start, ...], setup_s: float, deadline_s: float
) -> None:
    """Set an FMU up and end it; one that could be set up is not tried again."""
    FmuProcess(
        read_fmu(Path(file)), start, step_ns=1, setup_s=setup_s, deadline_s=deadline_s, logging=True
    ).close()
