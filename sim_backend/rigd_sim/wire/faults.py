"""Reads the planned faults of a simulation, and injects and clears them while it runs.

An entry names the part, the kind of fault, and its start, probability or condition. An entry can
also give a duration.
"""

from __future__ import annotations

import operator
import random
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Self

from annotated_types import Ge, Gt, Le
from pydantic import BaseModel, Field, ValidationError, model_validator

from rigd.model.errors import ConfigError
from rigd.model.units import parse_quantity
from rigd.sdk import Documented, In, wrong_entry
from rigd.sdk.yaml.document import read_document
from rigd_sim.wire.part import Part, State

#: Longer signs first, so that `<=` is not read as `<`.
_COMPARE: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
_CONDITION: Final = re.compile(r"\s*(\w+)\.(\w+)\s*(<=|>=|==|!=|<|>)\s*(\S.*?)\s*$")
#: Where states come from: a part's name, or ``plant``.
States = Mapping[str, Callable[[], State]]


#: A number of YAML 1.2.
_NUMBER: Final = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_HEXADECIMAL: Final = re.compile(r"0x[0-9a-fA-F]{1,16}")


class FaultEntry(Documented, BaseModel):  # both: ruff does not look into other modules
    """One entry of a fault file; without `at`, `when` or `probability` it shows at once."""

    part: str
    """The device or bus that shows it."""
    fault: str
    """Name of the fault; `{"do": "faults"}` lists all."""
    options: dict[str, Any] = {}
    """Options of the fault."""
    at: Annotated[float, In("s"), Ge(0), Le(1e6)] = 0.0
    """When: so long after the simulation has started (or after the request)."""
    for_: Annotated[float, In("s"), Gt(0), Le(1e6)] | None = Field(None, alias="for")
    """How long; without it until cleared."""
    probability: Annotated[float, In("1/s"), Gt(0), Le(1e3)] | None = None
    """Chance per second that it begins, again and again."""
    when: str | None = None
    """A condition, once: `carriage.position > 0.5 m`, `plant.slip_speed > 0.1 m/s`."""

    @model_validator(mode="after")
    def _one_reason(self) -> Self:
        if self.when is not None:
            if self.probability is not None:
                raise wrong_entry("give either `when` or `probability`", "probability")
            try:
                Condition.read(self.when)
            except ValueError as error:
                raise wrong_entry(str(error), "when") from error
        if self.probability is not None and self.for_ is None:
            raise wrong_entry(
                "a fault with a `probability` needs `for`: how long it lasts", "probability"
            )
        return self


@dataclass(frozen=True)
class Condition:
    """A comparison of one value of a part's state."""

    part: str
    key: str
    compare: Callable[[Any, Any], bool]
    value: float | str | bool

    @classmethod
    def read(cls, text: str) -> Condition:
        """Return the condition that ``text`` states.

        Raises:
            ValueError: it cannot be read.

        """
        match = _CONDITION.match(text)
        if match is None:
            raise ValueError(f"cannot read {text!r}; write it as 'carriage.position > 0.5 m'")
        part, key, compare, given = match.groups()
        value: float | str | bool
        if given in ("true", "false"):
            value = given == "true"
        elif given[0].isalpha():
            value = given
        else:
            value = parse_quantity(given).value
        return cls(part, key, _COMPARE[compare], value)

    def holds(self, states: States) -> bool:
        """Return whether it holds now.

        Raises:
            ValueError: there is no such part, or no such value in its state.

        """
        if self.part not in states:
            raise ValueError(f"there is no part {self.part!r}; there are {', '.join(states)}")
        state = states[self.part]()
        if self.key not in state:
            raise ValueError(f"{self.part} has no {self.key!r}; it has {', '.join(state)}")
        return self.compare(state[self.key], self.value)


@dataclass
class _Planned:
    """An entry with its planned times, in s of the schedule's clock."""

    entry: FaultEntry
    due: float
    ends: float | None = None
    condition: Condition | None = None
    looked: float = 0.0


@dataclass
class Schedule:
    """Injects and clears the planned faults as time advances."""

    parts: Mapping[str, Part]
    states: States
    seed: int = 0
    _planned: list[_Planned] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    @property
    def planned(self) -> bool:
        """Whether there is anything to come."""
        return bool(self._planned)

    def add(self, entry: FaultEntry, now: float) -> None:
        """Plan ``entry``; what is due at once is shown at once.

        Raises:
            ValueError: there is no such part, fault, or value.

        """
        part = self._part(entry.part)
        if entry.fault not in part.faults:
            known = "; ".join(f"{name}: {what}" for name, what in part.faults.items())
            raise ValueError(f"{part.name} has no fault {entry.fault!r}; it knows {known}")
        condition = None if entry.when is None else Condition.read(entry.when)
        if condition is not None:
            condition.holds(self.states)  # wrong names are reported now, not later
        planned = _Planned(entry, now + entry.at, condition=condition, looked=now + entry.at)
        if self._act(planned, now):
            self._planned.append(planned)

    def tick(self, now: float) -> list[str]:
        """Do what is due at ``now``; return what parts refused, a sentence each."""
        if not self._planned:
            return []
        refused, kept = [], []
        for planned in self._planned:
            try:
                if self._act(planned, now):
                    kept.append(planned)
            except ValueError as error:
                refused.append(f"{planned.entry.part}: {planned.entry.fault}: {error}")
        self._planned = kept
        return refused

    def clear(self, part: str | None = None, fault: str | None = None) -> None:
        """Forget what is planned, and end what is shown, of one part or of all.

        Raises:
            ValueError: there is no such part.

        """
        chosen = list(self.parts.values()) if part is None else [self._part(part)]
        names = {item.name for item in chosen}
        self._planned = [
            item
            for item in self._planned
            if item.entry.part not in names or fault not in (None, item.entry.fault)
        ]
        for item in chosen:
            item.clear(fault)

    def _part(self, name: str) -> Part:
        if name not in self.parts:
            raise ValueError(f"there is no part {name!r}; there are {', '.join(self.parts)}")
        return self.parts[name]

    def _act(self, planned: _Planned, now: float) -> bool:
        """Begin or end one fault; return whether there is more to come of it."""
        entry, part = planned.entry, self.parts[planned.entry.part]
        if planned.ends is not None:
            if now < planned.ends:
                return True
            part.clear(entry.fault)
            planned.ends, planned.looked = None, now
            return entry.probability is not None
        if now < planned.due or not self._begins(planned, now):
            return True
        part.inject(entry.fault, **entry.options)
        if entry.for_ is None:
            return False
        planned.ends = now + entry.for_
        return True

    def _begins(self, planned: _Planned, now: float) -> bool:
        if planned.condition is not None:
            return planned.condition.holds(self.states)
        if planned.entry.probability is None:
            return True
        elapsed, planned.looked = now - planned.looked, now
        return self._random.random() < planned.entry.probability * elapsed


def read_fault_file(path: Path) -> list[FaultEntry]:
    """Return the entries of a fault file.

    Raises:
        ConfigError: it cannot be read, or an entry is wrong; names every problem with its place.

    """
    document = read_document(path)
    tree = document.data
    listed = tree.get("faults") if isinstance(tree, dict) and list(tree) == ["faults"] else ""
    if not isinstance(listed, list | None):
        raise ConfigError(
            f"{path}: expected a list under `faults:`",
            hint="faults:\n    - {part: wheel_servo, fault: silent, at: 2 s, for: 0.5 s}",
        )
    entries, problems = [], []
    for index, item in enumerate(listed or ()):
        if isinstance(item, dict) and isinstance(item.get("options"), dict):
            item = {**item, "options": _plain(item["options"])}
        try:
            entries.append(FaultEntry.model_validate(item))
        except ValidationError as error:
            problems += [
                ConfigError(
                    f"{'.'.join(map(str, entry['loc'])) or 'entry'}: {entry['msg']}",
                    place=document.place(("faults", index)),
                )
                for entry in error.errors(include_url=False, include_context=False)
            ]
    if problems:
        raise ConfigError.several(problems)
    return entries


def _plain(data: Any) -> Any:
    """Return options as numbers, truth values and words: the reader keeps each as its text."""
    if isinstance(data, dict):
        return {name: _plain(item) for name, item in data.items()}
    if isinstance(data, list):
        return [_plain(item) for item in data]
    if data in ("true", "false"):
        return data == "true"
    if isinstance(data, str) and _HEXADECIMAL.fullmatch(data):
        return int(data, 16)
    if isinstance(data, str) and _NUMBER.fullmatch(data) and len(data) < 30:
        return float(data) if set(data) & set(".eE") else int(data)
    return data
