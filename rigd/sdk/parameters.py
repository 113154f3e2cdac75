"""Finds and reads the file of physical parameters of a plant."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ValidationError, ValidationInfo, field_validator, model_validator

from rigd.model.errors import ConfigError
from rigd.sdk.options.documented_model import Documented, WrongEntries
from rigd.sdk.plant import PlantConfig

M = TypeVar("M", bound=BaseModel)


class ParameterGroup(Documented):
    """A section of a plant's parameter file; its fields are quantities with unit and bounds."""


class ParametersConfig(PlantConfig):
    """The options of a plant whose physical parameters are in a separate file.

    The plant's own Config gives ``parameters`` the name of the shipped file as its default.
    """

    #: The folder of the parameter files that the plant's package ships.
    shipped_folder: ClassVar[Path]

    parameters: str
    """File of physical parameters: beside the rig file, or a shipped name."""

    @classmethod
    @abstractmethod
    def parameter_model(cls) -> type[ParameterGroup]:
        """Return the model of the file; imported here, so that listing plants is fast."""

    @model_validator(mode="before")
    @classmethod
    def _default_is_shipped(cls, options: Any) -> Any:
        """Give the path of the shipped file if none is named: no folder is searched for it."""
        if not isinstance(options, Mapping) or "parameters" in options:
            return options
        default = cls.find_parameters(cls.model_fields["parameters"].default)
        return {**options, "parameters": str(default)}

    @field_validator("parameters")
    @classmethod
    def _parameters_exist(cls, name: str, info: ValidationInfo) -> str:
        """Resolve the file; ``folder`` in the validation context is the folder of the rig file."""
        folder = (info.context or {}).get("folder")
        return str(cls.find_parameters(name, None if folder is None else Path(folder)))

    @classmethod
    def find_parameters(cls, name: str, folder: Path | None = None) -> Path:
        """Return the file for ``name``: an absolute path, in ``folder`` if given, or shipped.

        A shipped ``plants/sled.yaml`` may be given so, as ``sled.yaml`` or as ``sled``. The current
        folder is not searched: a file of that name may lie there by chance.

        Raises:
            ValueError: there is no such file; the message names the searched places.
        """
        own = Path(name) if folder is None else folder / name
        if own.is_file() and (folder is not None or own.is_absolute()):
            return own
        shipped = cls.shipped_folder
        for candidate in (shipped.parent / name, shipped / Path(name).with_suffix(".yaml")):
            if candidate.is_file():
                return candidate
        beside = "" if folder is None else f"neither {own} nor "
        raise ValueError(
            f"no parameter file '{name}': {beside or 'not '}a shipped one; "
            "leave 'parameters' out for the one that comes with the plant"
        )

    def read_parameters(self) -> Any:
        """Return the parameters in the file, as :meth:`parameter_model`.

        Raises:
            ConfigError: it cannot be read, a value is missing, unknown, out of bounds or in the
                wrong unit, or the whole is not physical; every problem with its place.

        """
        example = self.shipped_folder / type(self).model_fields["parameters"].default
        return load_parameters(Path(self.parameters), self.parameter_model(), example)

    def files(self) -> Mapping[Path, str]:
        """Return the parameter file; see :meth:`PlantConfig.files`."""
        self.read_parameters()
        path = Path(self.parameters)
        return {path: path.read_text("utf-8")}


def load_parameters(path: Path, model: type[M], example: Path) -> M:
    """Return the content of the YAML file at ``path`` as ``model``.

    ``example`` is the shipped file that the message of an error points to.

    Raises:
        ConfigError: see :meth:`ParametersConfig.read_parameters`.

    """
    from rigd.sdk.yaml.document import read_document  # the processes of a run read no file

    document = read_document(path)
    try:
        return model.model_validate(document.data)
    except ValidationError as error:
        raise ConfigError.several(
            [
                ConfigError(
                    f"{'.'.join(map(str, where)) or 'parameters'}: {words}",
                    place=document.place(where),
                    hint=f"{example} shows every key with its unit",
                )
                for item in error.errors(include_url=False)
                for where, words in _problems(item)
            ]
        ) from None


def _problems(item: Any) -> list[tuple[tuple[int | str, ...], str]]:
    """Return the entries that a validator refuses, each with the reason."""
    reason = item.get("ctx", {}).get("error")
    if isinstance(reason, WrongEntries):
        return [((*item["loc"], *below), words) for below, words in reason.problems]
    return [(item["loc"], _words(item))]


def _words(item: Any) -> str:
    """Return the problem of one entry, in terms of the file instead of the library."""
    known = {"extra_forbidden": "unknown key", "missing": "this key is missing"}
    if item["type"] in known:
        return known[item["type"]]
    words, found = str(item["msg"]).removeprefix("Value error, "), item["input"]
    is_value = isinstance(found, str | int | float) and str(found) not in words
    return f"{words}, found {str(found)!r}" if is_value else words
