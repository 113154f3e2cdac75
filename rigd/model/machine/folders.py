"""Makes the folder of a file that a person asks for."""

from __future__ import annotations

from pathlib import Path

from rigd.model.errors import RecordingError


def make_folder(folder: Path, option: str) -> None:
    """Make ``folder`` and those above it, if they are missing; ``option`` names another one.

    Raises:
        RecordingError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(
            f"cannot make the folder {folder}: {error.strerror}", hint=f"choose another {option}"
        ) from error
