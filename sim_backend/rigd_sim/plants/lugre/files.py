"""Finds and reads the file of physical parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rigd_sim.plants import parameter_files
from rigd_sim.plants.parameter_files import find_parameters

if TYPE_CHECKING:
    from rigd_sim.plants.lugre.parameters import LugreParameters

__all__ = ["find_parameters", "load_parameters"]


def load_parameters(path: Path) -> LugreParameters:
    """Return the parameters in the YAML file at ``path``.

    Raises:
        ConfigError: see :func:`rigd_sim.plants.parameter_files.load_parameters`.

    """
    from rigd_sim.plants.lugre.parameters import LugreParameters

    return parameter_files.load_parameters(path, LugreParameters, "configs/plants/lugre.yaml")
