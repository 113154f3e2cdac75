"""``@kernel`` for analyses: compiled functions whose results repeat bit for bit."""

from rigd.model.kernel import kernel

__all__ = ["kernel"]
