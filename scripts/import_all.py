"""Imports every module of rigd and its plug-ins once: what the user starts later starts at once.

Python keeps what it compiles beside each module that is imported. uv does not compile what it
installs, and without this step the first commands would, each for seconds. Containers often set
PYTHONDONTWRITEBYTECODE; then every command and every process of a run would, each time.
"""

from __future__ import annotations

import importlib
import pkgutil
import warnings

import rigd
import rigd_analyses
import rigd_drivers
import rigd_sim


def import_all() -> None:
    """Import all modules but those that run when they are imported."""
    with warnings.catch_warnings(action="ignore"):  # those of others are not for the user
        for package in (rigd, rigd_analyses, rigd_drivers, rigd_sim):
            for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
                if not module.name.endswith("__main__"):
                    importlib.import_module(module.name)


if __name__ == "__main__":
    import_all()
