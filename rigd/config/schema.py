"""Generates the JSON Schemas of the files that users write, from the models that check them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from rigd.config.calibration.calibration_source import CalibrationSource
from rigd.config.source import RigSource


def rig_schema() -> dict[str, Any]:
    """Return the JSON Schema of rig files; the options of drivers and plants are not checked."""
    return file_schema(RigSource, "rigd rig file")


def calibration_schema() -> dict[str, Any]:
    """Return the JSON Schema of calibration files."""
    return file_schema(CalibrationSource, "rigd calibration file")


def file_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the JSON Schema of the files that ``model`` describes."""
    schema = model.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": title}
