"""Asks a person a question in a separate thread while the cycle continues."""

from __future__ import annotations

import threading
from collections.abc import Callable


class PendingQuestion:
    """Runs ``ask`` in a thread of its own, which ends with the process if no answer comes."""

    def __init__(self, ask: Callable[[], None]) -> None:
        self._ask = ask
        self._answered = threading.Event()
        self._errors: list[Exception] = []
        threading.Thread(target=self._put, name="prompt", daemon=True).start()

    @property
    def answered(self) -> bool:
        """Whether ``ask`` has returned, or failed."""
        return self._answered.is_set()

    def wait(self, timeout_s: float) -> None:
        """Wait for the answer, at most ``timeout_s``."""
        self._answered.wait(timeout_s)

    def raise_error(self) -> None:
        """Raise the exception of ``ask``, if it raised any."""
        if self._errors:
            raise self._errors[0]

    def _put(self) -> None:
        try:
            self._ask()
        except Exception as error:  # noqa: BLE001 - raised again in the run's thread
            self._errors.append(error)
        finally:
            self._answered.set()
