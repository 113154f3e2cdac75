"""Decorator ``@kernel``: compiles functions of analyses; the same input gives the same bits."""

from rigd.model.kernel import kernel

__all__ = ["kernel"]
