"""Defines the rows of encoders: an angle or a position, and the counts that give the value."""

from __future__ import annotations

from rigd.sdk import Row


class AngleRow(Row):
    """The angle of a shaft in rad; what ``status`` means is the driver's."""

    angle: float
    counts: float
    status: int


class PositionRow(Row):
    """The position along a travel in m; what ``status`` means is the driver's."""

    position: float
    counts: float
    status: int
