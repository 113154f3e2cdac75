"""Defines the roles: what an identity (the name of a client) may do."""

from __future__ import annotations

from enum import Enum


class Role(Enum):
    """The rights of an identity; each role includes the previous role."""

    OBSERVER = "observer"  #: see everything, and stop
    OPERATOR = "operator"  #: run procedures
    MAINTAINER = "maintainer"  #: act on devices, take the lease from another

    def includes(self, other: Role) -> bool:
        """Whether this role includes the rights of ``other``."""
        order = list(Role)
        return order.index(self) >= order.index(other)
