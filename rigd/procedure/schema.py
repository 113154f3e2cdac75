"""Builds the JSON Schema of procedure files, with which an editor checks a file."""

from __future__ import annotations

from typing import Any

from rigd.config.schema import file_schema
from rigd.procedure.source import ProcedureSource


def procedure_schema() -> dict[str, Any]:
    """Return the JSON Schema of procedure files."""
    return file_schema(ProcedureSource, "rigd procedure file")
