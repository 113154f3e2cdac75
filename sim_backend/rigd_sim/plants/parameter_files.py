"""Finds and reads the file of physical parameters of any plant."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rigd.model.errors import ConfigError, Place
from rigd.sdk import shipped_configs

if TYPE_CHECKING:  # finding a file needs no pydantic
    from pydantic import BaseModel

M = TypeVar("M", bound="BaseModel")


def find_parameters(name: str, folder: Path | None = None) -> Path:
    """Return the file meant by ``name``: in ``folder`` (default: the current one), or shipped.

    Shipped names may be given as ``lugre``, ``lugre.yaml`` or ``plants/lugre.yaml``.

    Raises:
        ValueError: there is no such file; the message says where it was looked for.

    """
    beside = (folder or Path.cwd()) / name
    if beside.is_file():
        return beside
    shipped = shipped_configs()
    for candidate in (shipped / name, shipped / "plants" / Path(name).with_suffix(".yaml")):
        if candidate.is_file():
            return candidate
    raise ValueError(
        f"no parameter file '{name}': neither {beside} nor a shipped one; "
        "leave 'parameters' out for the paper's rig"
    )


def load_parameters(path: Path, model: type[M], example: str) -> M:
    """Return the parameters in the YAML file at ``path`` as ``model``.

    ``example`` is the shipped file that the message of an error points to.

    Raises:
        ConfigError: it cannot be read, a value is missing, unknown, out of bounds or in the wrong
            unit, or the whole is not physical; every problem with its place.

    """
    from pydantic import ValidationError
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        tree = YAML(typ="rt", pure=True).load(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        raise ConfigError.several(
            [
                ConfigError(
                    f"{'.'.join(map(str, item['loc'])) or 'parameters'}: {_words(item)}",
                    place=_place(path, tree, item["loc"]),
                    hint=f"{example} shows every key with its unit",
                )
                for item in error.errors(include_url=False, include_context=False)
            ]
        ) from None


def _words(item: Any) -> str:
    """Return what is wrong with one entry, in words of the file rather than of the library."""
    known = {"extra_forbidden": "unknown key", "missing": "this key is missing"}
    return known.get(item["type"], str(item["msg"]).removeprefix("Value error, "))


def _place(path: Path, tree: Any, location: tuple[int | str, ...]) -> Place:
    """Return where the entry at ``location`` stands, or the last one on the way to it."""
    line, column, node = 0, 0, tree
    for key in location:
        if not isinstance(node, dict) or key not in node:
            break
        line, column = node.lc.value(key)  # type: ignore[attr-defined] # ruamel's CommentedMap
        node = node[key]
    return Place(str(path), line + 1, column + 1)
