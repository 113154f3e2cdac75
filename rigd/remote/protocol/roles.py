"""Roles: what an identity may do."""

from __future__ import annotations

from enum import Enum


class Role(Enum):
    """What an identity may do; each may do what the one before may."""

    OBSERVER = "observer"  #: see everything, and stop
    OPERATOR = "operator"  #: run procedures
    MAINTAINER = "maintainer"  #: act on devices, take the lease from another

    def includes(self, other: Role) -> bool:
        """Whether this role may do what ``other`` may."""
        order = list(Role)
        return order.index(self) >= order.index(other)
