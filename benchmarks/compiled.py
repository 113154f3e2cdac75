"""Compiles a C reference against the layout of numpy records, to be compared with."""

from __future__ import annotations

import ctypes
import os
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

FLAGS = ("-O3", "-march=native", "-std=c11", "-fPIC", "-shared")


def compiled(
    source: Path, layout: Mapping[str, np.dtype[Any]], arguments: Sequence[Any]
) -> Callable[..., None]:
    """Return the function ``integrate`` of ``source``, which takes ``arguments`` (ctypes).

    ``source`` includes ``layout.h``: a struct of doubles for each name of ``layout``.
    """
    text = "".join(
        f"typedef struct {{ double {', '.join(dtype.names or ())}; }} {name};\n"
        for name, dtype in layout.items()
    )
    with tempfile.TemporaryDirectory(prefix="rigd-bench-") as folder:
        Path(folder, "layout.h").write_text(text, "utf-8")
        library = Path(folder, "reference.so")
        subprocess.run(
            [os.environ.get("CC", "cc"), *FLAGS, "-I", folder, "-o", library, source, "-lm"],
            check=True,
        )
        function = ctypes.CDLL(str(library)).integrate  # loaded: its file is no longer needed
    function.restype = None
    function.argtypes = list(arguments)
    return function
