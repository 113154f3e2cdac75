"""Base of groups of physical parameters: frozen, documented, unknown keys refused."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class ParameterGroup(BaseModel):
    """A section of a plant's parameter file; its fields are quantities with unit and bounds."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
