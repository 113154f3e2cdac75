"""Rig files: YAML with positions to typed objects, errors as file:line:column."""

from rigd.config.loader import load_rig, parse_rig
from rigd.config.rig import DeviceConfig, PlantSetup, RigConfig, SourceFile
from rigd.config.schema import rig_schema
from rigd.config.shipped import find_file
from rigd.sdk.shipped import shipped_folder

__all__ = [
    "DeviceConfig",
    "PlantSetup",
    "RigConfig",
    "SourceFile",
    "find_file",
    "load_rig",
    "parse_rig",
    "rig_schema",
    "shipped_folder",
]
