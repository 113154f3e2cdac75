"""Provides the decorator ``@kernel``: it compiles functions; the same input gives the same bits."""

from rigd.model.machine.kernel import inlined, kernel, part

__all__ = ["inlined", "kernel", "part"]
