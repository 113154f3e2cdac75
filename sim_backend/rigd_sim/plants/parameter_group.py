"""Base of groups of physical parameters: frozen, documented, unknown keys refused."""

from __future__ import annotations

from rigd.sdk import Documented


class ParameterGroup(Documented):
    """A section of a plant's parameter file; its fields are quantities with unit and bounds."""
