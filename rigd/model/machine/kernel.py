"""Provides the decorator ``@kernel``, which compiles a numerical function to machine code.

It is numba's ``njit`` with the same options for all of rigd; a type checker still sees the type of
the original function. numba stores a compiled function on disk beside its module (or in numba's
user cache if that folder cannot be written). So only the first call after an installation compiles;
:mod:`rigd.model.machine.compiling` announces it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core import event

from rigd.model.machine import compiling

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile ``function`` to machine code, without fast-math: results repeat bit for bit."""
    return cast(F, numba.njit(cache=True, error_model="numpy", nogil=True)(function))


def part(function: F) -> F:
    """Compile ``function`` with the kernels that call it, and store it with them alone.

    For a function that calls kernels of other files: by itself it would be stored with their code,
    and numba would not notice a change of them.
    """
    return cast(F, numba.njit(error_model="numpy", nogil=True)(function))


def inlined(function: F) -> F:
    """Compile ``function``, which allocates no array, into the kernels of its file that call it.

    Such a call costs nothing. A call of a ``@kernel`` counts references to each array argument,
    with locked instructions, which can take longer than a small function. The first call of one
    that does allocate, also by ``row[:] = (1.0, 2.0)``, raises numba's error "NRT required".
    """
    # No run time that counts references; the types of numba do not know this option.
    options: dict[str, Any] = {"forceinline": True, "_nrt": False}
    compiled = numba.njit(cache=True, error_model="numpy", nogil=True, **options)
    return cast(F, compiled(function))


class _Announcer(event.Listener):
    """Is called when numba compiles a function, and not when it finds the function on disk."""

    def on_start(self, _event: object) -> None:
        compiling.begins()

    def on_end(self, _event: object) -> None:
        pass


event.register("numba:compile", _Announcer())  # type: ignore[no-untyped-call]
