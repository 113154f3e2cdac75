"""``@kernel``: numba's ``njit`` with types.

Compiled functions are cached on disk beside their module (or in numba's user cache where that
folder cannot be written), so only the first call after an installation compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile ``function`` to machine code, without fast-math: results repeat bit for bit."""
    return cast(F, numba.njit(cache=True, error_model="numpy", nogil=True)(function))
