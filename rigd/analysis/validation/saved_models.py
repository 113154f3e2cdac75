"""Reads the JSON object of `rigd identify` back: the models that `rigd validate` tries."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from rigd.analysis.provenance import file_sha256
from rigd.analysis.result import FloatArray
from rigd.config.document import parse_document
from rigd.model.errors import ConfigError, Place

#: The keys and list indices that lead to a value of the file.
Keys = tuple[str | int, ...]

_MADE_BY: Final = "give the file that `rigd identify RECORDINGS --json > model.json` writes"


@dataclass(frozen=True, eq=False)
class SavedModel:
    """One group of a file: ``model`` names the analysis that made it.

    ``conditions`` are those of its trials, such as ``{"floor": "stone"}``. ``data`` is its object
    and ``keys`` are its place in ``path``.
    """

    path: Path
    text: str
    model: str
    group: str
    conditions: Mapping[str, str]
    data: Mapping[str, object]
    keys: Keys

    @property
    def name(self) -> str:
        """What a person calls it."""
        return f"{self.group or 'the model'} of {self.path.name}"

    @property
    def fits(self) -> bool:
        """Whether it fitted the recordings it was made from, as far as its method could judge."""
        gate = self.data.get("gate")
        return not isinstance(gate, dict) or gate.get("outcome") != "does not fit"

    def get(self, *keys: str | int) -> object:
        """Return the value at ``keys``; None if there is none."""
        value: object = self.data
        for key in keys:
            if isinstance(value, Mapping) and isinstance(key, str):
                value = value.get(key)
            elif isinstance(value, list) and isinstance(key, int) and key < len(value):
                value = value[key]
            else:
                return None
        return value

    def number(self, *keys: str | int) -> float:
        """Return the number at ``keys``.

        Raises:
            ConfigError: there is none.
        """
        value = self.get(*keys)
        if isinstance(value, bool) or not isinstance(value, int | float):
            shown = "is missing" if value is None else f"is {value!r}, must be a number"
            raise self.error(f"{_dotted(keys)} {shown}", keys, hint=_MADE_BY)
        return float(value)

    def texts(self, *keys: str | int) -> tuple[str, ...]:
        """Return the list of texts at ``keys``.

        Raises:
            ConfigError: there is no such list.
        """
        value = self.get(*keys)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.error(f"{_dotted(keys)} must be a list of texts", keys, hint=_MADE_BY)
        return tuple(value)

    def numbers(self, *keys: str | int, shape: tuple[int, ...]) -> FloatArray:
        """Return the array of ``shape`` at ``keys``.

        Raises:
            ConfigError: there is no such array of numbers.
        """
        value = self.get(*keys)
        size = " x ".join(str(count) for count in shape)
        try:
            found = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            found = np.empty(0)
        if found.shape != shape or not np.all(np.isfinite(found)):
            raise self.error(f"{_dotted(keys)} must be {size} numbers", keys, hint=_MADE_BY)
        return found

    def made_from(self, path: Path) -> bool:
        """Whether the recording at ``path``, or one it is a copy of, gave the model."""
        paths, digests = self.get("recordings"), self.get("recordings_sha256")
        if isinstance(digests, list) and file_sha256(path) in digests:
            return True
        return isinstance(paths, list) and path.resolve() in [Path(str(x)).resolve() for x in paths]

    def error(self, message: str, keys: Sequence[str | int], hint: str = "") -> ConfigError:
        """Return an error about the value at ``keys``, with its place in the file."""
        place = _place(self.text, self.path, (*self.keys, *keys))
        return ConfigError(message, place=place, hint=hint or None)


def read_models(path: Path) -> tuple[SavedModel, ...]:
    """Return the models of the file at ``path``, one for each group.

    Raises:
        ConfigError: the file cannot be read, is no JSON, or was not written by `rigd identify`.
    """
    start = Place(str(path), 1, 1)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot read the model {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        kind = "it is a recording" if path.suffix == ".mcap" else "it is no text"
        raise ConfigError(
            f"{path} is no model: {kind}",
            hint=f"the model stands first, then the recordings; {_MADE_BY}",
        ) from error
    try:
        data = json.loads(text, parse_constant=_refused)
    except ValueError as error:
        place = start
        if isinstance(error, json.JSONDecodeError):
            place = Place(str(path), error.lineno, error.colno)
        raise ConfigError(f"this is no JSON: {error}", place=place, hint=_MADE_BY) from error
    if not isinstance(data, dict):
        raise ConfigError("the model must be one JSON object", place=start, hint=_MADE_BY)
    groups = data.get("groups")
    if groups is None:
        return (_model(path, text, data, ()),)
    if not isinstance(groups, list) or not groups:
        raise ConfigError("groups must be a list of models", place=start, hint=_MADE_BY)
    return tuple(_model(path, text, item, ("groups", k)) for k, item in enumerate(groups))


def chosen(
    models: Sequence[SavedModel], conditions: Mapping[str, str], group: str = ""
) -> SavedModel:
    """Return the one of ``models`` for trials under ``conditions``; ``group`` names it, if given.

    A single model is returned with any conditions: the data decide whether it holds. Of several,
    it is the one whose conditions are those of the trials, as far as both name them.

    Raises:
        ConfigError: there is no such model, or there are several.
    """
    path = models[0].path
    there = ", ".join(model.group or "one without a name" for model in models)
    if group:
        named = [model for model in models if model.group == group]
        if len(named) != 1:
            raise ConfigError(f"--group {group}: {path} has no such model", hint=f"it has {there}")
        return named[0]
    if len(models) == 1:
        return models[0]
    found = [model for model in models if not differing(model, conditions)]
    named = [model for model in found if model.conditions]
    if len(named) != 1:
        wanted = (
            ", ".join(f"{name} {value}" for name, value in conditions.items()) or "no conditions"
        )
        how_many = "several models" if len(named) > 1 else "no model"
        raise ConfigError(
            f"{path} has {how_many} for trials with {wanted}",
            hint=f"it has {there}; `--group NAME` takes one for any recordings",
        )
    return named[0]


def differing(model: SavedModel, conditions: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of ``conditions`` that ``model`` has with another value."""
    return tuple(
        name
        for name, value in conditions.items()
        if name in model.conditions and model.conditions[name] != value
    )


def _model(path: Path, text: str, data: object, keys: Keys) -> SavedModel:
    if not isinstance(data, dict):
        place = _place(text, path, keys)
        raise ConfigError("a model must be a JSON object", place=place, hint=_MADE_BY)
    found = SavedModel(path, text, "", "", {}, data, keys)
    model, conditions = data.get("model"), data.get("conditions", {})
    if not isinstance(model, str):
        raise found.error("the file names no model", (), hint=_MADE_BY)
    if not isinstance(conditions, dict):
        raise found.error("conditions must be names with values", ("conditions",), hint=_MADE_BY)
    group = data.get("group")
    return SavedModel(
        path, text, model, group if isinstance(group, str) else "",
        {str(name): str(value) for name, value in conditions.items()}, data, keys,
    )  # fmt: skip


def _refused(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON number")


def _place(text: str, path: Path, keys: Keys) -> Place:
    """Return the place of ``keys``; JSON is YAML, whose parser keeps places."""
    try:
        return parse_document(text, path).place(keys)
    except (ConfigError, RecursionError):
        return Place(str(path), 1, 1)


def _dotted(keys: Sequence[str | int]) -> str:
    text = ""
    for key in keys:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else key
    return text
