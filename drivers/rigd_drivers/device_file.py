"""Reads what is known of a make of device from a file: shipped by name, or the lab's own by path.

A shipped file stands in ``maps/KIND``; one of the lab beside its rig file, in the same form.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import (
    BaseModel,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PrivateAttr,
    ValidationInfo,
)
from pydantic_core import CoreSchema, core_schema

from rigd.model.errors import ConfigError
from rigd.sdk import Documented
from rigd.sdk.parameters import load_parameters

_FOLDER: Final = Path(__file__).parent / "maps"
#: What a path of the lab's own file ends in; anything else is the name of a shipped one.
_SUFFIXES: Final = (".yaml", ".yml")

D = TypeVar("D", bound="DeviceFile")


class DeviceFile(Documented):
    """What is known of a make of device, and from where."""

    title: str
    """What the device is."""
    source: str
    """Manual and section, or electronic data sheet, that it is made from."""
    seen: bool = False
    """Whether it was used with such a device; false: it is from the manual alone."""
    _path: Path | None = PrivateAttr(None)

    def note_path(self, path: Path) -> None:
        """Note the file that it was read from."""
        self._path = path

    @property
    def own_path(self) -> Path | None:
        """The file of the lab that it was read from; None: a shipped one, or none at all."""
        return None if self._path is None or self._path.is_relative_to(_FOLDER) else self._path

    @property
    def standing(self) -> str:
        """What a person must know about where it comes from."""
        return "seen on the device" if self.seen else "from the manual, not seen on the device"


@dataclass(frozen=True)
class FromFile:
    """Marks an option with a :class:`DeviceFile`: written in the rig file, or named there.

    ``kind`` is the folder of the shipped ones.
    """

    kind: str

    def __get_pydantic_core_schema__(
        self, source: type[DeviceFile], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Read the file first if there is one."""
        read = partial(self._read, source)
        return core_schema.with_info_before_validator_function(read, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Describe the option to an editor as a name, or as the content of a file."""
        return {"anyOf": [{"type": "string"}, handler(schema)]}

    def _read(self, model: type[DeviceFile], value: object, info: ValidationInfo) -> object:
        if not isinstance(value, str):
            return value
        folder = (info.context or {}).get("folder")
        path = find(value, self.kind, Path.cwd() if folder is None else Path(folder))
        try:
            return read(path, model, next(iter(shipped(self.kind)), path))
        except ConfigError as error:
            raise ValueError(str(error)) from error


def shipped(kind: str) -> list[Path]:
    """Return the shipped files of ``kind``, by name."""
    return sorted((_FOLDER / kind).glob("*.yaml"))


def find(name: str, kind: str, folder: Path) -> Path:
    """Return the file for ``name``: a path from ``folder``, or the name of a shipped one.

    Raises:
        ValueError: there is none; names those there are.

    """
    if name.endswith(_SUFFIXES):
        path = folder / name
        if not path.is_file():
            raise ValueError(f"there is no file {path}")
        return path.resolve()
    known = {path.stem: path for path in shipped(kind)}
    if name in known:
        return known[name]
    close = difflib.get_close_matches(name, known, 1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    raise ValueError(
        f"no shipped {kind} map is called {name!r} ({', '.join(known)}){hint}; the name of a file "
        "of your own ends in .yaml"
    )


def read(path: Path, model: type[D], example: Path) -> D:
    """Return the file at ``path``; ``example`` is the one that messages point to.

    Raises:
        ConfigError: it cannot be read, or is wrong; every problem with its line.

    """
    return _read(path, path.stat().st_mtime_ns, model, example)  # type: ignore[return-value]


@lru_cache(maxsize=64)
def _read(path: Path, _changed_ns: int, model: type[DeviceFile], example: Path) -> DeviceFile:
    found = load_parameters(path, model, example)
    found.note_path(path)
    return found


def own_files(config: BaseModel) -> dict[Path, str]:
    """Return path and text of the lab's own files that options of ``config`` name."""
    values = (getattr(config, name) for name in type(config).model_fields)
    paths = (value.own_path for value in values if isinstance(value, DeviceFile))
    return {path: path.read_text("utf-8") for path in paths if path is not None}
